// Metrics that Prometheus can scrape.

#ifndef MANEUVER_SERVER_MONITORING_PROMETHEUS_METRICS_H_
#define MANEUVER_SERVER_MONITORING_PROMETHEUS_METRICS_H_

#include <filesystem>
#include <memory>
#include <string>

#include "server/monitoring/http_pages.h"
#include "server/monitoring/metrics.h"

namespace maneuver::monitoring {

class PrometheusMetrics : public MetricRegistry {
 public:
  static std::unique_ptr<PrometheusMetrics> Create();

  // Adds the size and the free space of the disk that holds `folder` to the page. Call once, before
  // the first Page.
  virtual void WatchDisk(const std::filesystem::path& folder) = 0;

  // Returns the page in Prometheus' text format, with the metrics of the process
  // (process_metrics.h).
  virtual std::string Page() const = 0;
};

// Returns the page /metrics, which shows the page of `metrics`. `metrics` must outlive it.
HttpPage MetricsPage(const PrometheusMetrics& metrics);

}  // namespace maneuver::monitoring

#endif  // MANEUVER_SERVER_MONITORING_PROMETHEUS_METRICS_H_
