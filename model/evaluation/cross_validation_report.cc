#include "model/evaluation/cross_validation_report.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
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

namespace maneuver::evaluation {
namespace {

using Recordings = google::protobuf::RepeatedPtrField<v1::GroupedRecording>;
using Names = google::protobuf::RepeatedPtrField<std::string>;

constexpr int kBins = ActionStatistics::kBins;

// Sums over examples, from which every figure is computed: the number of examples, each value, and
// for each bin of the calibration error confidence and responsibility.
struct Columns {
  explicit Columns(int value_count) : values(value_count) {}

  int values;
  int count() const { return 1 + values + 2 * kBins; }
  int value(int index) const { return 1 + index; }
  int confidence(int bin) const { return 1 + values + bin; }
  int responsibility(int bin) const { return 1 + values + kBins + bin; }
};

// A figure from the sums.
using Figure = std::function<double(const double* sums)>;

Figure MeanOf(const Columns& columns, int index) {
  return [at = columns.value(index)](const double* sums) { return sums[at] / sums[0]; };
}

Figure RatioOf(const Columns& columns, int numerator, int denominator) {
  return [n = columns.value(numerator), d = columns.value(denominator)](const double* sums) {
    return sums[n] / sums[d];
  };
}

Figure DifferenceOf(const Columns& columns, int ours, int theirs) {
  return [a = columns.value(ours), b = columns.value(theirs)](const double* sums) {
    return (sums[a] - sums[b]) / sums[0];
  };
}

Figure CalibrationErrorOf(const Columns& columns) {
  return [columns](const double* sums) {
    double error = 0.0;
    for (int bin = 0; bin < kBins; ++bin) {
      error += std::abs(sums[columns.confidence(bin)] - sums[columns.responsibility(bin)]);
    }
    return error / sums[0];
  };
}

// The sums of one part of the examples, by training seed and by group.
class PartSums {
 public:
  PartSums(Columns columns, int seeds) : columns_(columns), sums_(static_cast<size_t>(seeds)) {}

  void Add(size_t seed, int group, const v1::MeasuredExample& example) {
    Eigen::VectorXd& sums =
        sums_[seed].try_emplace(group, Eigen::VectorXd::Zero(columns_.count())).first->second;
    sums[0] += 1.0;
    for (int i = 0; i < columns_.values; ++i) sums[columns_.value(i)] += example.values(i);
    const int bin = std::min(kBins - 1, static_cast<int>(example.confidence() * kBins));
    sums[columns_.confidence(bin)] += example.confidence();
    sums[columns_.responsibility(bin)] += example.responsibility();
  }

  bool empty() const { return sums_.front().empty(); }
  const Columns& columns() const { return columns_; }
  int seeds() const { return static_cast<int>(sums_.size()); }
  int groups() const { return static_cast<int>(sums_.front().size()); }

  // Returns the sums over all groups. [columns]
  Eigen::VectorXd Total(size_t seed) const {
    Eigen::VectorXd total = Eigen::VectorXd::Zero(columns_.count());
    for (const auto& [_, sums] : sums_[seed]) total += sums;
    return total;
  }

  // Returns the sums over the groups of each draw. [columns, draws]
  //   draws: how often each group is in each of them, [draws, groups of the set]
  Eigen::MatrixXd Drawn(size_t seed, const Eigen::MatrixXd& draws) const {
    Eigen::MatrixXd counts(draws.rows(), static_cast<Eigen::Index>(sums_[seed].size()));
    Eigen::MatrixXd sums(columns_.count(), counts.cols());
    Eigen::Index at = 0;
    for (const auto& [group, of_group] : sums_[seed]) {
      counts.col(at) = draws.col(group);
      sums.col(at++) = of_group;
    }
    return sums * counts.transpose();
  }

 private:
  Columns columns_;
  std::vector<std::map<int, Eigen::VectorXd>> sums_;  // by seed, then by group
};

// Estimates of one part.
class Estimator {
 public:
  Estimator(const PartSums& part, const Eigen::MatrixXd& draws) {
    for (size_t seed = 0; seed < static_cast<size_t>(part.seeds()); ++seed) {
      totals_.push_back(part.Total(seed));
      drawn_.push_back(part.Drawn(seed, draws));
    }
  }

  v1::Estimate Estimate(const Figure& figure) const {
    const double seeds = static_cast<double>(totals_.size());
    v1::Estimate estimate;
    for (const Eigen::VectorXd& total : totals_) {
      estimate.add_seed_values(figure(total.data()));
      estimate.set_value(estimate.value() + *estimate.seed_values().rbegin() / seeds);
    }
    std::vector<double> drawn(static_cast<size_t>(drawn_.front().cols()));
    for (const Eigen::MatrixXd& of_seed : drawn_) {
      for (size_t i = 0; i < drawn.size(); ++i) {
        drawn[i] += figure(of_seed.col(static_cast<Eigen::Index>(i)).data()) / seeds;
      }
    }
    const Interval interval = PercentileInterval(std::move(drawn));
    estimate.set_lower(interval.lower);
    estimate.set_upper(interval.upper);
    return estimate;
  }

 private:
  std::vector<Eigen::VectorXd> totals_;  // of each seed
  std::vector<Eigen::MatrixXd> drawn_;   // of each seed, [columns, draws]
};

std::optional<int> IndexOf(const Names& names, std::string_view name) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) return std::nullopt;
  return static_cast<int>(found - names.begin());
}

// Another predictor, and how its metrics are named after the model's.
struct Rival {
  std::string_view name;
  std::string_view prefix;
  std::string_view suffix;  // of a predictor of one trajectory: in place of "_1" or "_medoid"
};

constexpr std::array<Rival, 5> kRivals = {{{"cv", "", "_cv"},
                                           {"ctra", "", "_ctra"},
                                           {"faded", "", "_faded"},
                                           {"covernet", "covernet_", ""},
                                           {"multipath", "multipath_", ""}}};

// What is compared; of all of these less is better.
constexpr std::array<std::string_view, 8> kCompared = {
    "ade_1", "fde_1", "miss_rate_1", "ade_medoid", "min_ade_6", "min_fde_6", "miss_rate_6", "nll"};

// Returns the rival's metric to hold against the model's; empty if it has none.
std::string RivalMetric(const Rival& rival, std::string_view metric) {
  if (rival.suffix.empty()) return std::string(rival.prefix) + std::string(metric);
  for (const std::string_view single : {"_1", "_medoid"}) {
    if (!metric.ends_with(single)) continue;
    metric.remove_suffix(single.size());
    return std::string(metric) + std::string(rival.suffix);
  }
  return "";
}

v1::RivalVerdict VerdictOn(const v1::Estimate& difference) {
  if (difference.upper() < 0.0) return v1::RIVAL_VERDICT_AHEAD;
  if (difference.lower() > 0.0) return v1::RIVAL_VERDICT_BEHIND;
  return v1::RIVAL_VERDICT_UNDECIDED;
}

void AddComparisons(const Estimator& estimator, const Columns& columns, const Names& names,
                    v1::CrossValidatedPart& proto) {
  for (const std::string_view metric : kCompared) {
    for (const Rival& rival : kRivals) {
      const std::string rival_metric = RivalMetric(rival, metric);
      const std::optional<int> ours = IndexOf(names, metric);
      const std::optional<int> theirs = IndexOf(names, rival_metric);
      if (!ours || !theirs) continue;
      v1::RivalComparison& comparison = *proto.add_comparisons();
      comparison.set_metric(std::string(metric));
      comparison.set_rival(std::string(rival.name));
      comparison.set_rival_metric(rival_metric);
      *comparison.mutable_difference() = estimator.Estimate(DifferenceOf(columns, *ours, *theirs));
      comparison.set_verdict(VerdictOn(comparison.difference()));
    }
  }
}

//   models: how many models of one seed measured each example
void Fill(const PartSums& part, const Eigen::MatrixXd& draws, const Names& names, int models,
          v1::CrossValidatedPart& proto) {
  const Columns& columns = part.columns();
  const Estimator estimator(part, draws);
  auto& metrics = *proto.mutable_metrics();
  for (int i = 0; i < names.size(); ++i) {
    metrics[names[i]] = estimator.Estimate(MeanOf(columns, i));
  }
  for (const MetricRatio& ratio : MetricRatios()) {
    const std::optional<int> numerator = IndexOf(names, ratio.numerator);
    const std::optional<int> denominator = IndexOf(names, ratio.denominator);
    if (!numerator || !denominator || !(part.Total(0)[columns.value(*denominator)] > 0.0)) continue;
    metrics[std::string(ratio.name)] =
        estimator.Estimate(RatioOf(columns, *numerator, *denominator));
  }
  metrics["calibration_error"] = estimator.Estimate(CalibrationErrorOf(columns));
  proto.set_examples(std::llround(part.Total(0)[0]) / models);
  proto.set_groups(part.groups());
  if (proto.examples() >= kLeastComparedExamples) {
    AddComparisons(estimator, columns, names, proto);
  }
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
    const auto weight = static_cast<double>(run.set->examples_size());
    for (const auto& [name, value] : run.set->set_metrics()) {
      if (name == "calibration_error") continue;  // has an interval
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

// Numbers the groups of a set from 0, and counts what is in them.
std::map<int, int> NumberGroups(const Recordings& recordings, v1::CrossValidatedSet& proto) {
  std::map<int, int> sizes;
  for (const v1::GroupedRecording& recording : recordings) ++sizes[recording.group()];
  std::map<int, int> numbers;
  for (const auto& [group, size] : sizes) {
    numbers.try_emplace(group, static_cast<int>(numbers.size()));
    proto.set_largest_group(std::max(proto.largest_group(), size));
  }
  proto.set_recordings(recordings.size());
  proto.set_groups(static_cast<int>(numbers.size()));
  return numbers;
}

//   models: how many models of one seed measured each example
void AddSet(std::span<const SetRun> runs, const Recordings& recordings, int seeds, int models,
            const BootstrapOptions& options, v1::CrossValidatedSet& proto) {
  const std::map<int, int> groups = NumberGroups(recordings, proto);
  const v1::MeasuredSet& first = *runs.front().set;
  const Columns columns(first.value_names_size());
  PartSums overall(columns, seeds);
  std::vector<std::vector<PartSums>> strata;  // by dimension
  for (const v1::StratumDimension& dimension : first.dimensions()) {
    strata.emplace_back(static_cast<size_t>(dimension.names_size()), PartSums(columns, seeds));
  }
  for (const SetRun& run : runs) {
    for (const v1::MeasuredExample& example : run.set->examples()) {
      const int group = groups.at(recordings[example.recording()].group());
      overall.Add(run.seed, group, example);
      for (size_t i = 0; i < strata.size(); ++i) {
        const auto stratum = static_cast<size_t>(example.strata(static_cast<int>(i)));
        strata[i][stratum].Add(run.seed, group, example);
      }
    }
  }
  const Eigen::MatrixXd draws = DrawGroups(proto.groups(), options.resamples, options.seed);
  Fill(overall, draws, first.value_names(), models, *proto.mutable_overall());
  for (size_t i = 0; i < strata.size(); ++i) {
    const v1::StratumDimension& dimension = first.dimensions(static_cast<int>(i));
    for (size_t j = 0; j < strata[i].size(); ++j) {
      if (strata[i][j].empty()) continue;
      v1::CrossValidatedPart& part = *proto.add_strata();
      part.set_dimension(dimension.dimension());
      part.set_name(dimension.names(static_cast<int>(j)));
      Fill(strata[i][j], draws, first.value_names(), models, part);
    }
  }
  for (auto& [name, range] : RangesOf(runs, static_cast<size_t>(seeds))) {
    (*proto.mutable_set_metrics())[name] = range;
  }
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
  AddSet(held_out, plan.recordings(), plan.seeds_size(), 1, options, *report.add_sets());
  for (size_t i = 0; i < tests.size(); ++i) {
    const v1::TestDataset& dataset = plan.test_datasets(static_cast<int>(i));
    v1::CrossValidatedSet& set = *report.add_sets();
    set.set_name(dataset.name());
    set.set_left_out(dataset.left_out());
    AddSet(tests[i], dataset.recordings(), plan.seeds_size(), plan.folds(), options, set);
  }
  return report;
}

}  // namespace maneuver::evaluation
