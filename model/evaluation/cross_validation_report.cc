#include "model/evaluation/cross_validation_report.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "model/evaluation/bootstrap.h"
#include "model/evaluation/calibration.h"
#include "model/evaluation/example_metrics.h"
#include "model/evaluation/rival_comparison.h"
#include "model/evaluation/rival_table.h"

namespace maneuver::evaluation {
namespace {

using Recordings = google::protobuf::RepeatedPtrField<v1::GroupedRecording>;
using Names = google::protobuf::RepeatedPtrField<std::string>;

constexpr int kBins = ActionStatistics::kBins;

// The columns of an example: 1, its values, and its confidence and responsibility for each bin of
// the calibration error.
struct Columns {
  explicit Columns(int value_count) : values(value_count) {}

  int values;
  int count() const { return 1 + values + 2 * kBins; }
  int value(int index) const { return 1 + index; }
  int confidence(int bin) const { return 1 + values + bin; }
  int responsibility(int bin) const { return 1 + values + kBins + bin; }

  Eigen::VectorXd Row(const v1::MeasuredExample& example) const {
    Eigen::VectorXd row = Eigen::VectorXd::Zero(count());
    row[0] = 1.0;
    for (int i = 0; i < values; ++i) row[value(i)] = example.values(i);
    const int bin = std::clamp(static_cast<int>(example.confidence() * kBins), 0, kBins - 1);
    row[confidence(bin)] = example.confidence();
    row[responsibility(bin)] = example.responsibility();
    return row;
  }
};

Figure CalibrationErrorOf(const Columns& columns) {
  return [columns](const double* sums) {
    double error = 0.0;
    for (int bin = 0; bin < kBins; ++bin) {
      error += std::abs(sums[columns.confidence(bin)] - sums[columns.responsibility(bin)]);
    }
    return error / sums[0];
  };
}

std::optional<int> IndexOf(const Names& names, std::string_view name) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) return std::nullopt;
  return static_cast<int>(found - names.begin());
}

//   models: number of models of one seed that measured each example
void Fill(const GroupedSums& part, const Eigen::MatrixXd& draws, const Names& names, int models,
          v1::CrossValidatedPart& proto) {
  const Columns columns(names.size());
  const Estimator estimator(part, draws);
  auto& metrics = *proto.mutable_metrics();
  for (int i = 0; i < names.size(); ++i) {
    metrics[names[i]] = estimator.Estimate(MeanFigure(columns.value(i)));
  }
  for (const MetricRatio& ratio : MetricRatios()) {
    const std::optional<int> numerator = IndexOf(names, ratio.numerator);
    const std::optional<int> denominator = IndexOf(names, ratio.denominator);
    if (!numerator || !denominator || !(part.Total(0)[columns.value(*denominator)] > 0.0)) continue;
    metrics[std::string(ratio.name)] =
        estimator.Estimate(RatioFigure(columns.value(*numerator), columns.value(*denominator)));
  }
  metrics["calibration_error"] = EstimateByJackknife(part, CalibrationErrorOf(columns));
  proto.set_examples(std::llround(part.Total(0)[0]) / models);
  proto.set_groups(part.groups());
  if (proto.examples() < kLeastComparedExamples) return;
  const auto column = [&](std::string_view name) -> std::optional<int> {
    const std::optional<int> index = IndexOf(names, name);
    if (!index) return std::nullopt;
    return columns.value(*index);
  };
  for (v1::RivalComparison& comparison : CompareWithRivals(estimator, column)) {
    *proto.add_comparisons() = std::move(comparison);
  }
}

// Returns how much a metric of some examples counts in a mean over the folds. The metrics of
// recorded manoeuvres are of the labelled examples alone.
double WeightOf(std::string_view metric, int64_t examples,
                const google::protobuf::Map<std::string, double>& metrics) {
  if (metric == "nmi" || metric == "purity") {
    const auto labelled = metrics.find("labelled_examples");
    if (labelled != metrics.end()) return labelled->second;
  }
  return static_cast<double>(examples);
}

// One model's measurements of a set, and the number of its seed.
struct SetRun {
  size_t seed = 0;
  const v1::MeasuredSet* set = nullptr;
};

std::map<std::string, v1::ModelRange> RangesOf(std::span<const SetRun> runs, size_t seeds) {
  struct Sum {
    std::vector<double> values;  // of each seed
    std::vector<double> weights;
  };
  std::map<std::string, Sum> sums;
  std::map<std::string, v1::ModelRange> ranges;
  for (const SetRun& run : runs) {
    for (const auto& [name, value] : run.set->set_metrics()) {
      if (name == "calibration_error") continue;  // is of all folds together
      const double weight = WeightOf(name, run.set->examples_size(), run.set->set_metrics());
      Sum& sum = sums[name];
      sum.values.resize(seeds);
      sum.weights.resize(seeds);
      sum.values[run.seed] += weight * value;
      sum.weights[run.seed] += weight;
      const auto [place, first] = ranges.try_emplace(name);
      v1::ModelRange& range = place->second;
      range.set_smallest(first ? value : std::min(range.smallest(), value));
      range.set_largest(first ? value : std::max(range.largest(), value));
    }
  }
  for (auto& [name, range] : ranges) {
    const Sum& sum = sums[name];
    for (size_t seed = 0; seed < seeds; ++seed) {
      range.add_seed_values(sum.values[seed] / sum.weights[seed]);
      range.set_value(range.value() + *range.seed_values().rbegin() / static_cast<double>(seeds));
    }
  }
  return ranges;
}

// A set metric of a model without the examples of a block of groups.
struct LeftOut {
  double weight = 0.0;
  double value = 0.0;
};

// Returns nothing if the set has the block and not the metric without it.
std::optional<LeftOut> WithoutBlock(const v1::MeasuredSet& set, int block,
                                    const std::string& metric) {
  const auto value = set.set_metrics().find(metric);
  if (value == set.set_metrics().end()) return std::nullopt;
  for (const v1::SetWithoutBlock& without : set.without()) {
    if (without.block() != block) continue;
    if (without.examples() == 0) return LeftOut();
    const auto left = without.set_metrics().find(metric);
    if (left == without.set_metrics().end()) return std::nullopt;
    return LeftOut{WeightOf(metric, without.examples(), without.set_metrics()), left->second};
  }
  return LeftOut{WeightOf(metric, set.examples_size(), set.set_metrics()), value->second};
}

// Returns a range's value without the examples of a block, nothing if it cannot be known.
std::optional<double> ValueWithoutBlock(std::span<const SetRun> runs, size_t seeds, int block,
                                        const std::string& metric) {
  std::vector<double> sums(seeds);
  std::vector<double> weights(seeds);
  for (const SetRun& run : runs) {
    const std::optional<LeftOut> left = WithoutBlock(*run.set, block, metric);
    if (!left) return std::nullopt;
    sums[run.seed] += left->weight * left->value;
    weights[run.seed] += left->weight;
  }
  double value = 0.0;
  for (size_t seed = 0; seed < seeds; ++seed) {
    if (!(weights[seed] > 0.0)) return std::nullopt;
    value += sums[seed] / weights[seed] / static_cast<double>(seeds);
  }
  return value;
}

// The jackknife says nothing of a count, and is inconsistent for a largest value, by which actions
// are effective.
bool HasInterval(std::string_view metric) {
  return metric != "labelled_examples" && !metric.ends_with("effective_actions");
}

// Sets the intervals of the ranges whose models have what is needed.
void AddIntervals(std::span<const SetRun> runs, size_t seeds,
                  std::map<std::string, v1::ModelRange>& ranges) {
  std::set<int> blocks;
  for (const SetRun& run : runs) {
    if (run.set->without().empty()) return;
    for (const v1::SetWithoutBlock& without : run.set->without()) blocks.insert(without.block());
  }
  for (auto& [metric, range] : ranges) {
    if (!HasInterval(metric)) continue;
    std::vector<double> values;
    for (const int block : blocks) {
      const std::optional<double> value = ValueWithoutBlock(runs, seeds, block, metric);
      if (value) values.push_back(*value);
    }
    if (values.size() < 2 || values.size() < blocks.size()) continue;
    const Interval interval = JackknifeInterval(range.value(), values);
    range.set_lower(interval.lower);
    range.set_upper(interval.upper);
  }
}

// Numbers the groups of a set from 0, modulo kMostDrawnGroups. Writes how many groups and recordings
// there are to `proto`.
std::map<int, int> NumberGroups(const Recordings& recordings, v1::CrossValidatedSet& proto) {
  std::map<int, int> sizes;
  for (const v1::GroupedRecording& recording : recordings) ++sizes[recording.group()];
  std::map<int, int> numbers;
  for (const auto& [group, size] : sizes) {
    numbers.try_emplace(group, static_cast<int>(numbers.size()) % kMostDrawnGroups);
    proto.set_largest_group(std::max(proto.largest_group(), size));
  }
  proto.set_recordings(recordings.size());
  proto.set_groups(static_cast<int>(numbers.size()));
  return numbers;
}

//   datasets: of the recordings; less than two are no dimension
//   models: number of models of one seed that measured each example
void AddSet(std::span<const SetRun> runs, const Recordings& recordings, const Names& datasets,
            int seeds, int models, const BootstrapOptions& options, v1::CrossValidatedSet& proto) {
  const std::map<int, int> groups = NumberGroups(recordings, proto);
  const v1::MeasuredSet& first = *runs.front().set;
  const Columns columns(first.value_names_size());
  auto dimensions = first.dimensions();
  if (datasets.size() > 1) {
    v1::StratumDimension& dimension = *dimensions.Add();
    dimension.set_dimension("dataset");
    *dimension.mutable_names() = datasets;
  }
  GroupedSums overall(columns.count(), seeds);
  std::vector<std::vector<GroupedSums>> strata;  // by dimension
  for (const v1::StratumDimension& dimension : dimensions) {
    strata.emplace_back(static_cast<size_t>(dimension.names_size()),
                        GroupedSums(columns.count(), seeds));
  }
  for (const SetRun& run : runs) {
    for (const v1::MeasuredExample& example : run.set->examples()) {
      const v1::GroupedRecording& recording = recordings[example.recording()];
      const int group = groups.at(recording.group());
      const Eigen::VectorXd row = columns.Row(example);
      overall.Add(run.seed, group, row);
      for (int i = 0; i < dimensions.size(); ++i) {
        const int stratum = i < example.strata_size() ? example.strata(i) : recording.dataset();
        strata[static_cast<size_t>(i)][static_cast<size_t>(stratum)].Add(run.seed, group, row);
      }
    }
  }
  const Eigen::MatrixXd draws =
      DrawGroups(std::min(proto.groups(), kMostDrawnGroups), options.resamples, options.seed);
  Fill(overall, draws, first.value_names(), models, *proto.mutable_overall());
  for (size_t i = 0; i < strata.size(); ++i) {
    const v1::StratumDimension& dimension = dimensions[static_cast<int>(i)];
    for (size_t j = 0; j < strata[i].size(); ++j) {
      if (strata[i][j].empty()) continue;
      v1::CrossValidatedPart& part = *proto.add_strata();
      part.set_dimension(dimension.dimension());
      part.set_name(dimension.names(static_cast<int>(j)));
      Fill(strata[i][j], draws, first.value_names(), models, part);
    }
  }
  std::map<std::string, v1::ModelRange> ranges = RangesOf(runs, static_cast<size_t>(seeds));
  AddIntervals(runs, static_cast<size_t>(seeds), ranges);
  for (const auto& [name, range] : ranges) (*proto.mutable_set_metrics())[name] = range;
}

}  // namespace

v1::CrossValidationReport MakeCrossValidationReport(const v1::CrossValidationPart& whole,
                                                    const BootstrapOptions& options) {
  const v1::CrossValidationPlan& plan = whole.plan();
  v1::CrossValidationReport report;
  *report.mutable_settings() = plan.settings();
  report.set_folds(plan.folds());
  report.set_fold_seed(plan.fold_seed());
  *report.mutable_seeds() = plan.seeds();
  report.set_resamples(options.resamples);

  std::vector<SetRun> held_out;
  std::vector<std::vector<SetRun>> tests(static_cast<size_t>(plan.test_datasets_size()));
  for (const v1::FoldRun& run : whole.runs()) {
    const auto seed = static_cast<size_t>(
        std::find(plan.seeds().begin(), plan.seeds().end(), run.seed()) - plan.seeds().begin());
    held_out.push_back({seed, &run.held_out()});
    for (size_t i = 0; i < tests.size(); ++i) {
      tests[i].push_back({seed, &run.tests(static_cast<int>(i))});
    }
  }
  AddSet(held_out, plan.recordings(), plan.dataset_names(), plan.seeds_size(), 1, options,
         *report.add_sets());
  for (size_t i = 0; i < tests.size(); ++i) {
    const v1::TestDataset& dataset = plan.test_datasets(static_cast<int>(i));
    v1::CrossValidatedSet& set = *report.add_sets();
    set.set_name(dataset.name());
    set.set_left_out(dataset.left_out());
    AddSet(tests[i], dataset.recordings(), {}, plan.seeds_size(), plan.folds(), options, set);
  }
  return report;
}

}  // namespace maneuver::evaluation
