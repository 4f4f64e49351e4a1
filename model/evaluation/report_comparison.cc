#include "model/evaluation/report_comparison.h"

#include <google/protobuf/util/message_differencer.h>

#include <algorithm>
#include <climits>
#include <cmath>
#include <limits>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "model/evaluation/metric_table.h"
#include "model/scene/duration.h"

namespace maneuver::evaluation {
namespace {

using google::protobuf::util::MessageDifferencer;

std::string SettingsText(const v1::ExampleSettings& settings) {
  return absl::StrCat(
      "stride=", scene::ToSeconds(settings.stride()), "s keep_standing=", settings.keep_standing(),
      " standing_distance=", settings.standing_distance(), " max_speed=", settings.max_speed());
}

std::string WaypointsText(const v1::TrajectorySpec& trajectory) {
  return absl::StrCat(trajectory.waypoints(), " waypoints of ",
                      scene::ToSeconds(trajectory.waypoint_interval()), " s");
}

// Returns "VEHICLE", or "PEDESTRIAN and CYCLIST", in an order that does not depend on the report.
std::string TypesText(const v1::EvaluationReport& report) {
  std::set<std::string> names;
  for (const int type : report.target_types()) {
    names.emplace(absl::StripPrefix(v1::AgentType_Name(type), "AGENT_TYPE_"));
  }
  return names.empty() ? "VEHICLE" : absl::StrJoin(names, " and ");
}

absl::Status NotComparable(const std::string& why) {
  return absl::FailedPreconditionError(absl::StrCat("the reports cannot be compared: ", why));
}

// Compares the metrics that both reports have.
std::vector<v1::MetricComparison> CompareMetrics(
    const google::protobuf::Map<std::string, double>& baseline,
    const google::protobuf::Map<std::string, double>& candidate) {
  std::vector<std::pair<int, v1::MetricComparison>> ranked;
  for (const auto& [name, before] : baseline) {
    const auto after = candidate.find(name);
    if (after == candidate.end()) continue;
    const std::optional<MetricInfo> metric = FindMetric(name);
    v1::MetricComparison comparison;
    comparison.set_metric(name);
    comparison.set_baseline_value(before);
    comparison.set_candidate_value(after->second);
    if (metric) {
      comparison.set_unit(std::string(metric->unit));
      comparison.set_verdict(Judge(*metric, before, after->second, 0.0));
    }
    ranked.emplace_back(metric ? metric->rank : INT_MAX, std::move(comparison));
  }
  std::ranges::sort(ranked, [](const auto& a, const auto& b) {
    return std::pair(a.first, a.second.metric()) < std::pair(b.first, b.second.metric());
  });
  std::vector<v1::MetricComparison> comparisons;
  comparisons.reserve(ranked.size());
  for (auto& [_, comparison] : ranked) comparisons.push_back(std::move(comparison));
  return comparisons;
}

}  // namespace

bool ChooseTheSameExamples(const v1::ExampleSettings& a, const v1::ExampleSettings& b) {
  return MessageDifferencer::Equals(a.stride(), b.stride()) &&
         a.keep_standing() == b.keep_standing() && a.standing_distance() == b.standing_distance() &&
         a.max_speed() == b.max_speed();
}

absl::Status CheckComparable(const v1::EvaluationReport& a, const v1::EvaluationReport& b) {
  if (a.dataset() != b.dataset()) {
    return NotComparable(absl::StrCat("one is on ", a.dataset(), ", the other on ", b.dataset(),
                                      "; evaluate both versions on one of them"));
  }
  if (a.dataset_sha256() != b.dataset_sha256()) {
    const auto& older = a.create_time().seconds() < b.create_time().seconds() ? a : b;
    return NotComparable(absl::StrCat(a.dataset(),
                                      " was another dataset when one of them was measured; "
                                      "evaluate ",
                                      older.model_version(), " on it again"));
  }
  if (!ChooseTheSameExamples(a.example_settings(), b.example_settings())) {
    return NotComparable(absl::StrCat(
        "they chose other examples, one by ", SettingsText(a.example_settings()), ", the other by ",
        SettingsText(b.example_settings()), "; evaluate both versions with the same settings"));
  }
  if (TypesText(a) != TypesText(b)) {
    return NotComparable(absl::StrCat("one version predicts ", TypesText(a), ", the other ",
                                      TypesText(b), "; their examples are of other agents"));
  }
  if (!MessageDifferencer::Equals(a.trajectory(), b.trajectory())) {
    return NotComparable(absl::StrCat("one version predicts ", WaypointsText(a.trajectory()),
                                      ", the other ", WaypointsText(b.trajectory()),
                                      "; their errors are over other times"));
  }
  if (a.examples() != b.examples()) {
    return NotComparable(absl::StrCat(
        "one is over ", a.examples(), " examples, the other over ", b.examples(),
        ": the versions look at pasts of other lengths, or were measured by other releases; "
        "evaluate both again if so"));
  }
  return absl::OkStatus();
}

absl::StatusOr<v1::MetricComparison> CompareMetric(const v1::EvaluationReport& baseline,
                                                   const v1::EvaluationReport& candidate,
                                                   const std::string& metric, double tolerance) {
  const std::optional<MetricInfo> info = FindMetric(metric);
  if (!info) return absl::FailedPreconditionError(absl::StrCat("there is no metric ", metric));
  for (const auto* report : {&baseline, &candidate}) {
    if (report->metrics().contains(metric)) continue;
    return absl::FailedPreconditionError(
        absl::StrCat("the report of ", report->model_version(), " has no ", metric));
  }
  v1::MetricComparison comparison;
  comparison.set_metric(metric);
  comparison.set_unit(std::string(info->unit));
  comparison.set_baseline_value(baseline.metrics().at(metric));
  comparison.set_candidate_value(candidate.metrics().at(metric));
  comparison.set_tolerance(tolerance);
  comparison.set_verdict(
      Judge(*info, comparison.baseline_value(), comparison.candidate_value(), tolerance));
  return comparison;
}

absl::StatusOr<v1::EvaluationComparison> CompareReports(const v1::EvaluationReport& baseline,
                                                        const v1::EvaluationReport& candidate) {
  if (absl::Status status = CheckComparable(baseline, candidate); !status.ok()) return status;
  v1::EvaluationComparison comparison;
  comparison.set_baseline(baseline.model_version());
  comparison.set_candidate(candidate.model_version());
  comparison.set_dataset(baseline.dataset());
  comparison.set_examples(baseline.examples());
  for (auto& metric : CompareMetrics(baseline.metrics(), candidate.metrics())) {
    *comparison.add_metrics() = std::move(metric);
  }
  for (const v1::EvaluationStratum& part : baseline.strata()) {
    const auto other = std::ranges::find_if(candidate.strata(), [&](const auto& each) {
      return each.dimension() == part.dimension() && each.name() == part.name();
    });
    if (other == candidate.strata().end()) continue;
    v1::StratumComparison& stratum = *comparison.add_strata();
    stratum.set_dimension(part.dimension());
    stratum.set_name(part.name());
    stratum.set_examples(part.examples());
    for (auto& metric : CompareMetrics(part.metrics(), other->metrics())) {
      *stratum.add_metrics() = std::move(metric);
    }
  }
  return comparison;
}

}  // namespace maneuver::evaluation
