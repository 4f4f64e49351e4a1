#include "model/evaluation/rival_comparison.h"

#include <algorithm>
#include <set>
#include <string>
#include <utility>

#include "model/evaluation/bootstrap.h"
#include "model/evaluation/example_metrics.h"
#include "model/evaluation/rival_table.h"
#include "model/evaluation/strata.h"

namespace maneuver::evaluation {
namespace {

v1::RivalVerdict VerdictOn(const v1::Estimate& difference, int groups) {
  if (groups < kLeastDecidingGroups) return v1::RIVAL_VERDICT_UNDECIDED;
  if (difference.upper() < 0.0) return v1::RIVAL_VERDICT_AHEAD;
  if (difference.lower() > 0.0) return v1::RIVAL_VERDICT_BEHIND;
  return v1::RIVAL_VERDICT_UNDECIDED;
}

// Returns the metrics to compare, of the model and of its rivals. Column i + 1 is metric i.
std::vector<ExampleMetric> MetricsToCompare(const MeasuredExamples& measured) {
  std::set<std::string> wanted;
  for (const std::string_view metric : kComparedMetrics) {
    wanted.emplace(metric);
    for (const Rival& rival : kRivals) wanted.insert(RivalMetric(rival, metric));
  }
  std::vector<ExampleMetric> metrics =
      ExampleMetrics(measured.measured_by_waymo, measured.measured.front().covernet.has_value());
  std::erase_if(metrics, [&](const ExampleMetric& each) { return !wanted.contains(each.name); });
  return metrics;
}

// One part of the examples.
struct ComparedPart {
  std::string_view dimension;
  std::string_view name;
  GroupedSums sums;
  int64_t examples = 0;
};

// One way to divide the examples, with the sums of its parts.
struct Division {
  const Stratification* stratification;
  std::vector<ComparedPart> parts;
};

std::vector<Division> Divide(int columns) {
  std::vector<Division> divisions;
  for (const Stratification& each : Stratifications()) {
    if (each.dimension != "speed" && each.dimension != "class") continue;
    Division& division = divisions.emplace_back(Division{&each, {}});
    for (const std::string_view name : each.names) {
      division.parts.push_back({each.dimension, name, GroupedSums(columns, 1)});
    }
  }
  return divisions;
}

}  // namespace

std::vector<v1::RivalComparison> CompareWithRivals(
    const Estimator& estimator, const std::function<std::optional<int>(std::string_view)>& column) {
  std::vector<v1::RivalComparison> comparisons;
  for (const std::string_view metric : kComparedMetrics) {
    for (const Rival& rival : kRivals) {
      const std::string rival_metric = RivalMetric(rival, metric);
      const std::optional<int> ours = column(metric);
      const std::optional<int> theirs = column(rival_metric);
      if (!ours || !theirs) continue;
      v1::RivalComparison& comparison = comparisons.emplace_back();
      comparison.set_metric(std::string(metric));
      comparison.set_rival(std::string(rival.name));
      comparison.set_rival_metric(rival_metric);
      *comparison.mutable_difference() = estimator.Estimate(DifferenceFigure(*ours, *theirs));
      comparison.set_verdict(VerdictOn(comparison.difference(), estimator.groups()));
    }
  }
  return comparisons;
}

v1::RivalStandings MakeRivalStandings(const MeasuredExamples& measured,
                                      const data::RecordingGroups& groups,
                                      const BootstrapOptions& options) {
  const std::vector<ExampleMetric> metrics = MetricsToCompare(measured);
  const auto column = [&](std::string_view name) -> std::optional<int> {
    const auto found = std::ranges::find(metrics, name, &ExampleMetric::name);
    if (found == metrics.end()) return std::nullopt;
    return static_cast<int>(found - metrics.begin()) + 1;
  };
  const int columns = static_cast<int>(metrics.size()) + 1;
  ComparedPart all{"", "", GroupedSums(columns, 1)};
  std::vector<Division> divisions = Divide(columns);
  Eigen::VectorXd row(columns);
  for (size_t i = 0; i < measured.examples.size(); ++i) {
    const Measurement& each = measured.measured[i];
    row[0] = 1.0;
    for (int j = 1; j < columns; ++j) row[j] = metrics[static_cast<size_t>(j) - 1].value(each);
    const int group = groups.groups[static_cast<size_t>(measured.examples[i].recording)];
    const auto add = [&](ComparedPart& part) {
      part.sums.Add(0, group, row);
      ++part.examples;
    };
    add(all);
    for (Division& division : divisions) {
      add(division.parts[static_cast<size_t>(division.stratification->stratum(each.keys))]);
    }
  }

  v1::RivalStandings standings;
  standings.set_recordings(static_cast<int>(groups.ids.size()));
  standings.set_groups(groups.count);
  standings.set_largest_group(groups.LargestGroup());
  standings.set_resamples(options.resamples);
  const Eigen::MatrixXd draws = DrawGroups(groups.count, options.resamples, options.seed);
  const auto write = [&](const ComparedPart& part) {
    if (part.examples == 0) return;
    v1::RivalStanding& standing = *standings.add_parts();
    standing.set_dimension(std::string(part.dimension));
    standing.set_name(std::string(part.name));
    standing.set_examples(part.examples);
    standing.set_groups(part.sums.groups());
    if (part.examples < kLeastComparedExamples) return;
    for (v1::RivalComparison& each : CompareWithRivals(Estimator(part.sums, draws), column)) {
      each.mutable_difference()->clear_seed_values();  // there is one model
      *standing.add_comparisons() = std::move(each);
    }
  };
  write(all);
  for (const Division& division : divisions) {
    for (const ComparedPart& part : division.parts) write(part);
  }
  return standings;
}

}  // namespace maneuver::evaluation
