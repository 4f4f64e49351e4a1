// Metrics that Prometheus can scrape.

#ifndef MANEUVER_SERVER_MONITORING_PROMETHEUS_METRICS_H_
#define MANEUVER_SERVER_MONITORING_PROMETHEUS_METRICS_H_

#include <filesystem>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/monitoring/metrics.h"

namespace maneuver::monitoring {

class PrometheusMetrics : public MetricRegistry {
 public:
  static std::unique_ptr<PrometheusMetrics> Create();

  // Adds the size and the free space of the disk that holds `folder` to the page. Call at most
  // once, before Listen.
  virtual void WatchDisk(const std::filesystem::path& folder) = 0;

  // Returns the page in Prometheus' text format, with the metrics of the process
  // (process_metrics.h).
  virtual std::string Page() const = 0;

  // Serves the page under http://ADDRESS/metrics until this object is destroyed. Call at most once.
  //   address: HOST:PORT; port 0 picks a free one.
  // Returns the port that it listens on, or UNAVAILABLE if it cannot listen there.
  virtual absl::StatusOr<int> Listen(const std::string& address) = 0;
};

}  // namespace maneuver::monitoring

#endif  // MANEUVER_SERVER_MONITORING_PROMETHEUS_METRICS_H_
