// Reads Prometheus metrics pages.

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
  // Parses the text format (version 0.0.4). Ignores lines of any other form.
  static MetricsPage Parse(std::string_view text);

  // Returns the sum of all samples of this name that have at least these labels; nothing if there
  // are none.
  std::optional<double> Sum(std::string_view name, const MetricLabels& labels = {}) const;
  // Returns a histogram's cumulative counts, by upper bound; the last bound is infinite. Adds up
  // all histograms with these labels.
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
  std::map<double, double> buckets = {};  // as in MetricsPage::Buckets

  // Both are NaN if nothing was observed. The quantile is interpolated within its bucket; beyond
  // the last finite bound it is that bound.
  double Mean() const;
  double Quantile(double quantile) const;
};
// Returns the change of a histogram. Adds up all histograms with these labels.
HistogramChange Change(const MetricsPage& before, const MetricsPage& after, std::string_view name,
                       const MetricLabels& labels = {});

// Returns INVALID_ARGUMENT for anything but http://HOST:PORT/PATH, or HOST:PORT alone for its
// /metrics.
absl::Status CheckMetricsAddress(const std::string& url);

// Fetches a page over plain HTTP. INVALID_ARGUMENT as CheckMetricsAddress. UNAVAILABLE if nobody listens there, if the answer is not
// 200 OK, if the server takes longer than `patience` to connect or to send something, or if the
// page is longer than 16 MiB or is still arriving after `patience`.
absl::StatusOr<MetricsPage> FetchMetrics(
    const std::string& url, std::chrono::milliseconds patience = std::chrono::seconds(2));

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_METRICS_PAGE_H_
