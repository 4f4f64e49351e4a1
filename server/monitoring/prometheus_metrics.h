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

  // From now on the page says how large the disk is that holds `folder`, and how much of it is
  // free. Call before the first Page, once.
  virtual void WatchDisk(const std::filesystem::path& folder) = 0;

  // Returns the page in Prometheus' text format, with the metrics of the process
  // (process_metrics.h).
  virtual std::string Page() const = 0;
};

// /metrics, which shows the page of `metrics`; these outlive it.
HttpPage MetricsPage(const PrometheusMetrics& metrics);

}  // namespace maneuver::monitoring

#endif  // MANEUVER_SERVER_MONITORING_PROMETHEUS_METRICS_H_
