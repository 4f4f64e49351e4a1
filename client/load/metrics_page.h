// What a Prometheus metrics page says.

#ifndef MANEUVER_CLIENT_LOAD_METRICS_PAGE_H_
#define MANEUVER_CLIENT_LOAD_METRICS_PAGE_H_

#include <chrono>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace maneuver::load {

using MetricLabels = std::map<std::string, std::string, std::less<>>;

// A page at one moment.
class MetricsPage {
 public:
  // Reads the text format (version 0.0.4). Lines that are none of it are passed over.
  static MetricsPage Parse(std::string_view text);

  // The sum of all samples of this name that have at least these labels. Nothing if there is none.
  std::optional<double> Sum(std::string_view name, const MetricLabels& labels = {}) const;
  // A histogram's counts of observations of at most each bound, the last one infinite. The bounds
  // are the keys. Several with these labels are added up.
  std::map<double, double> Buckets(std::string_view name, const MetricLabels& labels = {}) const;

 private:
  struct Sample {
    std::string name;
    MetricLabels labels;
    double value = 0.0;
  };
  std::vector<Sample> samples_;
};

// What a histogram observed between two pages.
struct HistogramChange {
  double count = 0.0;
  double sum = 0.0;
  std::map<double, double> buckets = {};  // as of MetricsPage::Buckets

  // Of nothing observed, both are NaN. The quantile is interpolated in its bucket; beyond the last
  // finite bound it is that bound.
  double Mean() const;
  double Quantile(double quantile) const;
};
HistogramChange Change(const MetricsPage& before, const MetricsPage& after, std::string_view name,
                       const MetricLabels& labels = {});

// Fetches a page over plain HTTP: http://HOST:PORT/PATH, or HOST:PORT alone for /metrics there.
// INVALID_ARGUMENT for another address; UNAVAILABLE if it cannot be had within `patience`.
absl::StatusOr<MetricsPage> FetchMetrics(
    const std::string& url, std::chrono::milliseconds patience = std::chrono::seconds(2));

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_METRICS_PAGE_H_
