#include "model/evaluation/rival_comparison.h"

#include <algorithm>
#include <set>
#include <string>
#include <utility>

#include "model/evaluation/bootstrap.h"
#include "model/evaluation/rival_table.h"

namespace maneuver::evaluation {
namespace {

v1::RivalVerdict VerdictOn(const v1::Estimate& difference, int groups) {
  if (groups < kLeastDecidingGroups) return v1::RIVAL_VERDICT_UNDECIDED;
  if (difference.upper() < 0.0) return v1::RIVAL_VERDICT_AHEAD;
  if (difference.lower() > 0.0) return v1::RIVAL_VERDICT_BEHIND;
  return v1::RIVAL_VERDICT_UNDECIDED;
}

// Returns the metrics to compare, of the model and of its rivals.
std::vector<ExampleMetric> MetricsToCompare(bool measured_by_waymo, bool with_baselines) {
  std::set<std::string> wanted;
  for (const std::string_view metric : kComparedMetrics) {
    wanted.emplace(metric);
    for (const Rival& rival : kRivals) wanted.insert(RivalMetric(rival, metric));
  }
  std::vector<ExampleMetric> metrics = ExampleMetrics(measured_by_waymo, with_baselines);
  std::erase_if(metrics, [&](const ExampleMetric& each) { return !wanted.contains(each.name); });
  return metrics;
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

void RivalSums::Begin(const Measurement& first) {
  metrics_ = MetricsToCompare(measured_by_waymo_, first.covernet.has_value());
  const int columns = static_cast<int>(metrics_.size()) + 1;
  row_ = Eigen::VectorXd::Ones(columns);
  all_.push_back({"", "", GroupedSums(columns, 1)});
  for (const Stratification& each : Stratifications()) {
    if (each.dimension != "speed" && each.dimension != "class") continue;
    Division& division = divisions_.emplace_back(Division{&each, {}});
    for (const std::string_view name : each.names) {
      division.parts.push_back({each.dimension, name, GroupedSums(columns, 1)});
    }
  }
}

void RivalSums::Add(size_t recording, const Measurement& measured) {
  if (all_.empty()) Begin(measured);
  for (size_t i = 0; i < metrics_.size(); ++i) {
    row_[static_cast<Eigen::Index>(i) + 1] = metrics_[i].value(measured);
  }
  const int group = groups_.groups[recording] % kMostDrawnGroups;
  const auto add = [&](Part& part) {
    part.sums.Add(0, group, row_);
    ++part.examples;
  };
  add(all_.front());
  for (Division& division : divisions_) {
    const int stratum = division.stratification->stratum(measured.keys);
    add(division.parts[static_cast<size_t>(stratum)]);
  }
}

std::optional<int> RivalSums::Column(std::string_view metric) const {
  const auto found = std::ranges::find(metrics_, metric, &ExampleMetric::name);
  if (found == metrics_.end()) return std::nullopt;
  return static_cast<int>(found - metrics_.begin()) + 1;
}

v1::RivalStandings RivalSums::MakeStandings(const BootstrapOptions& options) const {
  v1::RivalStandings standings;
  standings.set_recordings(static_cast<int>(groups_.ids.size()));
  standings.set_groups(groups_.count);
  standings.set_largest_group(groups_.LargestGroup());
  standings.set_resamples(options.resamples);
  const Eigen::MatrixXd draws =
      DrawGroups(std::min(groups_.count, kMostDrawnGroups), options.resamples, options.seed);
  const auto column = [this](std::string_view metric) { return Column(metric); };
  const auto write = [&](const Part& part) {
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
  for (const Part& part : all_) write(part);
  for (const Division& division : divisions_) {
    for (const Part& part : division.parts) write(part);
  }
  return standings;
}

}  // namespace maneuver::evaluation
