// Metrics that Prometheus can fetch.

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

  // From now on the page says how large the disk is that holds `folder`, and how much of it is
  // free. Call before Listen, once.
  virtual void WatchDisk(const std::filesystem::path& folder) = 0;

  // The page, in Prometheus' text format; with the metrics of the process (process_metrics.h).
  virtual std::string Page() const = 0;

  // Serves the page under http://ADDRESS/metrics until this object is destroyed.
  //   address: HOST:PORT; port 0 takes a free one.
  // The port that it listens on, or UNAVAILABLE if it cannot listen there. Call once.
  virtual absl::StatusOr<int> Listen(const std::string& address) = 0;
};

}  // namespace maneuver::monitoring

#endif  // MANEUVER_SERVER_MONITORING_PROMETHEUS_METRICS_H_
