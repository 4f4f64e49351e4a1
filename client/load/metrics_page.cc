#include "client/load/metrics_page.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"

namespace maneuver::load {
namespace {

// Removes `{a="b",c="d"}` from the front. Returns false if it is incomplete.
bool TakeLabels(std::string_view* rest, MetricLabels* labels) {
  rest->remove_prefix(1);
  while (!rest->empty() && rest->front() != '}') {
    const size_t equals = rest->find("=\"");
    if (equals == std::string_view::npos) return false;
    const std::string name(rest->substr(0, equals));
    rest->remove_prefix(equals + 2);
    std::string value;
    while (!rest->empty() && rest->front() != '"') {
      if (rest->front() == '\\' && rest->size() > 1) {
        rest->remove_prefix(1);
        value += rest->front() == 'n' ? '\n' : rest->front();
      } else {
        value += rest->front();
      }
      rest->remove_prefix(1);
    }
    if (rest->empty()) return false;
    rest->remove_prefix(1);
    labels->emplace(name, std::move(value));
    if (!rest->empty() && rest->front() == ',') rest->remove_prefix(1);
  }
  if (rest->empty()) return false;
  rest->remove_prefix(1);
  return true;
}

bool Has(const MetricLabels& all, const MetricLabels& wanted) {
  return std::all_of(wanted.begin(), wanted.end(), [&](const auto& label) {
    const auto found = all.find(label.first);
    return found != all.end() && found->second == label.second;
  });
}

}  // namespace

MetricsPage MetricsPage::Parse(std::string_view text) {
  MetricsPage page;
  for (const absl::string_view line :
       absl::StrSplit(absl::string_view(text.data(), text.size()), '\n', absl::SkipWhitespace())) {
    std::string_view rest(line.data(), line.size());
    if (rest.front() == '#') continue;
    Sample sample;
    const size_t name_end = rest.find_first_of("{ ");
    if (name_end == std::string_view::npos) continue;
    sample.name = rest.substr(0, name_end);
    rest.remove_prefix(name_end);
    if (rest.front() == '{' && !TakeLabels(&rest, &sample.labels)) continue;
    // A timestamp may follow the value.
    const std::vector<absl::string_view> words =
        absl::StrSplit(absl::string_view(rest.data(), rest.size()), ' ', absl::SkipWhitespace());
    if (words.empty() || !absl::SimpleAtod(words.front(), &sample.value)) continue;
    page.samples_.push_back(std::move(sample));
  }
  return page;
}

std::optional<double> MetricsPage::Sum(std::string_view name, const MetricLabels& labels) const {
  std::optional<double> sum;
  for (const Sample& sample : samples_) {
    if (sample.name == name && Has(sample.labels, labels)) sum = sum.value_or(0.0) + sample.value;
  }
  return sum;
}

std::map<double, double> MetricsPage::Buckets(std::string_view name,
                                              const MetricLabels& labels) const {
  std::map<double, double> buckets;
  const std::string samples = std::string(name) + "_bucket";
  for (const Sample& sample : samples_) {
    if (sample.name != samples || !Has(sample.labels, labels)) continue;
    const auto bound = sample.labels.find("le");
    double upper = 0.0;
    if (bound == sample.labels.end() || !absl::SimpleAtod(bound->second, &upper)) continue;
    buckets[upper] += sample.value;
  }
  return buckets;
}

double HistogramChange::Mean() const {
  return count > 0.0 ? sum / count : std::numeric_limits<double>::quiet_NaN();
}

double HistogramChange::Quantile(double quantile) const {
  if (!(count > 0.0) || buckets.empty()) return std::numeric_limits<double>::quiet_NaN();
  const double wanted = quantile * count;
  double lower = 0.0;
  double below = 0.0;
  for (const auto& [upper, up_to_here] : buckets) {
    if (up_to_here >= wanted && up_to_here > below) {
      if (std::isinf(upper)) return lower;
      return lower + (upper - lower) * (wanted - below) / (up_to_here - below);
    }
    lower = std::isinf(upper) ? lower : upper;
    below = up_to_here;
  }
  return lower;
}

HistogramChange Change(const MetricsPage& before, const MetricsPage& after, std::string_view name,
                       const MetricLabels& labels) {
  const std::string text(name);
  const auto change = [&](const std::string& part) {
    return after.Sum(text + part, labels).value_or(0.0) -
           before.Sum(text + part, labels).value_or(0.0);
  };
  HistogramChange result{.count = change("_count"), .sum = change("_sum")};
  result.buckets = after.Buckets(name, labels);
  const std::map<double, double> earlier = before.Buckets(name, labels);
  for (auto& [upper, count] : result.buckets) {
    if (const auto found = earlier.find(upper); found != earlier.end()) count -= found->second;
  }
  return result;
}

}  // namespace maneuver::load
