#include "client/cli/comparison_text.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/resource_names.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"
#include "model/evaluation/metric_table.h"

namespace maneuver::cli {
namespace {

constexpr std::array<std::string_view, 3> kOfStrata = {"min_ade_6", "miss_rate_6", "nll"};

std::string Better(const v1::MetricComparison& metric, const v1::EvaluationComparison& versions) {
  switch (metric.verdict()) {
    case v1::METRIC_VERDICT_BETTER:
      return ShortName(versions.candidate());
    case v1::METRIC_VERDICT_WORSE:
      return ShortName(versions.baseline());
    case v1::METRIC_VERDICT_NO_WORSE:
      return metric.candidate_value() == metric.baseline_value() ? "=" : "within";
    default:
      return "";
  }
}

// The cells from the metric's name on.
std::vector<std::string> Cells(const v1::MetricComparison& metric,
                               const v1::EvaluationComparison& versions) {
  const bool is_share = metric.unit() == "share";
  const double scale = is_share ? 100.0 : 1.0;
  const int digits = is_share ? 2 : 3;
  const double difference = scale * (metric.candidate_value() - metric.baseline_value());
  const std::string sign = difference > 0.0 ? "+" : "";
  return {metric.metric(),
          is_share ? "%" : metric.unit(),
          Fixed(scale * metric.baseline_value(), digits),
          Fixed(scale * metric.candidate_value(), digits),
          std::isfinite(difference) ? sign + Fixed(difference, digits) : "-",
          Better(metric, versions)};
}

std::vector<Column> Columns(const v1::EvaluationComparison& versions) {
  return {{"METRIC"},
          {"UNIT"},
          {ShortName(versions.baseline()), Align::kRight},
          {ShortName(versions.candidate()), Align::kRight},
          {"DIFFERENCE", Align::kRight},
          {"BETTER"}};
}

}  // namespace

std::string ComparisonText(const v1::EvaluationComparison& comparison, bool color) {
  Table table(Columns(comparison));
  for (const v1::MetricComparison& metric : comparison.metrics()) {
    const auto info = evaluation::FindMetric(metric.metric());
    if (!info || info->of_model) table.Add(Cells(metric, comparison));
  }
  return table.Text(color);
}

std::string StrataText(const v1::EvaluationComparison& comparison, bool color) {
  std::vector<Column> columns = Columns(comparison);
  columns.insert(columns.begin(), {{"EXAMPLES BY"}, {"EXAMPLES", Align::kRight}});
  Table table(std::move(columns));
  for (const v1::StratumComparison& stratum : comparison.strata()) {
    for (const v1::MetricComparison& metric : stratum.metrics()) {
      if (std::ranges::find(kOfStrata, metric.metric()) == kOfStrata.end()) continue;
      std::vector<std::string> cells = Cells(metric, comparison);
      cells.insert(cells.begin(), {absl::StrCat(stratum.dimension(), ": ", stratum.name()),
                                   absl::StrCat(stratum.examples())});
      table.Add(std::move(cells));
    }
  }
  return table.empty() ? "" : table.Text(color);
}

}  // namespace maneuver::cli
