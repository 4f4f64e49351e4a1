#include "model/evaluation/report.h"

#include <algorithm>
#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "model/evaluation/action_meaning.h"
#include "model/evaluation/anchor_report.h"
#include "model/evaluation/calibration.h"
#include "model/evaluation/example_metrics.h"

namespace maneuver::evaluation {
namespace {

using Metrics = google::protobuf::Map<std::string, double>;
using Part = std::vector<const Measurement*>;

// Writes the means of the metrics for which `wanted` returns true.
void SetMeans(const Part& part, std::span<const ExampleMetric> all, auto wanted, Metrics& metrics) {
  for (const ExampleMetric& metric : all) {
    if (!wanted(metric.name)) continue;
    double sum = 0.0;
    for (const Measurement* each : part) sum += metric.value(*each);
    metrics[metric.name] = sum / static_cast<double>(part.size());
  }
}

void SetRatios(Metrics& metrics) {
  for (const MetricRatio& ratio : MetricRatios()) {
    const double denominator = metrics.at(std::string(ratio.denominator));
    if (!(denominator > 0.0)) continue;
    metrics[std::string(ratio.name)] = metrics.at(std::string(ratio.numerator)) / denominator;
  }
}

ActionStatistics StatisticsOf(const Part& part) {
  ActionStatistics statistics(static_cast<int>(part.front()->probabilities.size()));
  for (const Measurement* each : part) statistics.Add(each->probabilities, each->responsibilities);
  return statistics;
}

void SetActions(const ActionStatistics& statistics, Metrics& metrics) {
  metrics["effective_actions"] = statistics.EffectiveActions();
  metrics["largest_share"] = statistics.MeanProbability().maxCoeff();
  metrics["action_perplexity"] = statistics.Perplexity();
  metrics["action_entropy"] = statistics.MeanEntropy();
  metrics["mutual_information"] = statistics.MutualInformation();
  metrics["calibration_error"] = statistics.ExpectedCalibrationError();
}

// The metrics of each stratum, besides the calibration error.
constexpr std::array<std::string_view, 20> kMainMetrics = {
    "ade_1",     "fde_1",       "ade_medoid",      "fde_medoid",      "min_ade_6",
    "min_fde_6", "miss_rate_6", "min_ade_cover_6", "min_fde_cover_6", "miss_rate_cover_6",
    "ade_cv",    "fde_cv",      "ade_ctra",        "fde_ctra",        "ade_faded",
    "fde_faded", "nll",         "nll_prior",       "coverage_1sigma", "coverage_2sigma"};

void SetMain(const Part& part, std::span<const ExampleMetric> all, Metrics& metrics) {
  const auto is_main = [](std::string_view name) {
    return std::ranges::find(kMainMetrics, name) != kMainMetrics.end();
  };
  SetMeans(part, all, is_main, metrics);
  metrics["calibration_error"] = StatisticsOf(part).ExpectedCalibrationError();
}

void AddStrata(std::span<const Measurement> measured, std::span<const ExampleMetric> all,
               v1::EvaluationReport& report) {
  for (const Stratification& stratification : Stratifications()) {
    std::vector<Part> parts(stratification.names.size());
    for (const Measurement& each : measured) {
      parts[static_cast<size_t>(stratification.stratum(each.keys))].push_back(&each);
    }
    for (size_t i = 0; i < parts.size(); ++i) {
      v1::EvaluationStratum& stratum = *report.add_strata();
      stratum.set_dimension(std::string(stratification.dimension));
      stratum.set_name(std::string(stratification.names[i]));
      stratum.set_examples(static_cast<int64_t>(parts[i].size()));
      if (!parts[i].empty()) SetMain(parts[i], all, *stratum.mutable_metrics());
    }
  }
}

void AddReliability(const ActionStatistics& statistics, v1::EvaluationReport& report) {
  for (int i = 0; i < ActionStatistics::kBins; ++i) {
    const ActionStatistics::Bin& bin = statistics.bins()[static_cast<size_t>(i)];
    v1::ReliabilityBin& proto = *report.add_reliability();
    proto.set_lower(static_cast<double>(i) / ActionStatistics::kBins);
    proto.set_upper(static_cast<double>(i + 1) / ActionStatistics::kBins);
    proto.set_examples(bin.examples);
    if (bin.examples == 0) continue;
    proto.set_mean_confidence(bin.confidence / static_cast<double>(bin.examples));
    proto.set_mean_responsibility(bin.responsibility / static_cast<double>(bin.examples));
  }
}

void AddActionUses(const ActionStatistics& statistics, v1::EvaluationReport& report) {
  const Eigen::VectorXd probabilities = statistics.MeanProbability();
  for (Eigen::Index action = 0; action < probabilities.size(); ++action) {
    v1::ActionUse& use = *report.add_action_uses();
    use.set_probability(probabilities[action]);
    use.set_largest_probability(statistics.LargestProbability()[action]);
  }
}

}  // namespace

v1::EvaluationReport MakeReport(std::span<const Measurement> measured, bool measured_by_waymo) {
  v1::EvaluationReport report;
  report.set_examples(static_cast<int64_t>(measured.size()));
  Part all;
  for (const Measurement& each : measured) all.push_back(&each);
  const std::vector<ExampleMetric> metrics =
      ExampleMetrics(measured_by_waymo, measured.front().covernet.has_value());
  SetMeans(
      all, metrics, [](const std::string&) { return true; }, *report.mutable_metrics());
  SetRatios(*report.mutable_metrics());
  const ActionStatistics statistics = StatisticsOf(all);
  SetActions(statistics, *report.mutable_metrics());
  const Eigen::VectorXd usage = statistics.MeanProbability();
  report.mutable_action_usage()->Add(usage.begin(), usage.end());
  AddReliability(statistics, report);
  AddStrata(measured, metrics, report);
  AddActionUses(statistics, report);
  AddMeaning(measured, report);
  AddAnchorMetrics(measured, report);
  return report;
}

}  // namespace maneuver::evaluation
