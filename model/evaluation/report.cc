#include "model/evaluation/report.h"

#include <algorithm>
#include <array>
#include <string>
#include <string_view>

#include "model/evaluation/strata.h"

namespace maneuver::evaluation {
namespace {

using Metrics = google::protobuf::Map<std::string, double>;

void SetRatios(Metrics& metrics) {
  for (const MetricRatio& ratio : MetricRatios()) {
    const double denominator = metrics.at(std::string(ratio.denominator));
    if (!(denominator > 0.0)) continue;
    metrics[std::string(ratio.name)] = metrics.at(std::string(ratio.numerator)) / denominator;
  }
}

// The metrics of each stratum, besides the calibration error.
constexpr std::array<std::string_view, 20> kStoredPerStratum = {
    "ade_1",     "fde_1",       "ade_medoid",      "fde_medoid",      "min_ade_6",
    "min_fde_6", "miss_rate_6", "min_ade_cover_6", "min_fde_cover_6", "miss_rate_cover_6",
    "ade_cv",    "fde_cv",      "ade_ctra",        "fde_ctra",        "ade_faded",
    "fde_faded", "nll",         "nll_prior",       "coverage_1sigma", "coverage_2sigma"};

bool IsStoredPerStratum(std::string_view metric) {
  return std::ranges::find(kStoredPerStratum, metric) != kStoredPerStratum.end();
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

void ReportSums::Part::Add(std::span<const double> values, const Measurement& measured) {
  for (size_t i = 0; i < values.size(); ++i) sums[i] += values[i];
  statistics.Add(measured.probabilities, measured.responsibilities);
  ++examples;
}

void ReportSums::Begin(const Measurement& first) {
  metrics_ = ExampleMetrics(measured_by_waymo_, first.covernet.has_value());
  values_.resize(metrics_.size());
  sums_.resize(metrics_.size());
  const Part none(metrics_.size(), static_cast<int>(first.probabilities.size()));
  for (const Stratification& stratification : Stratifications()) {
    strata_.emplace_back(stratification.names.size(), none);
  }
}

void ReportSums::Add(const Measurement& measured) {
  if (examples() == 0) Begin(measured);
  for (size_t i = 0; i < metrics_.size(); ++i) {
    values_[i] = metrics_[i].value(measured);
    sums_[i] += values_[i];
  }
  set_.Add(measured);
  for (size_t i = 0; i < strata_.size(); ++i) {
    const int stratum = Stratifications()[i].stratum(measured.keys);
    strata_[i][static_cast<size_t>(stratum)].Add(values_, measured);
  }
  Widen(measured.keys, input_ranges_);
}

void ReportSums::AddStrata(v1::EvaluationReport& report) const {
  for (size_t i = 0; i < strata_.size(); ++i) {
    const Stratification& stratification = Stratifications()[i];
    for (size_t j = 0; j < strata_[i].size(); ++j) {
      const Part& part = strata_[i][j];
      v1::EvaluationStratum& stratum = *report.add_strata();
      stratum.set_dimension(std::string(stratification.dimension));
      stratum.set_name(std::string(stratification.names[j]));
      stratum.set_examples(part.examples);
      if (part.examples == 0) continue;
      Metrics& metrics = *stratum.mutable_metrics();
      for (size_t k = 0; k < metrics_.size(); ++k) {
        if (!IsStoredPerStratum(metrics_[k].name)) continue;
        metrics[metrics_[k].name] = part.sums[k] / static_cast<double>(part.examples);
      }
      metrics["calibration_error"] = part.statistics.ExpectedCalibrationError();
    }
  }
}

v1::EvaluationReport ReportSums::MakeReport() const {
  v1::EvaluationReport report;
  report.set_examples(examples());
  Metrics& metrics = *report.mutable_metrics();
  for (size_t i = 0; i < metrics_.size(); ++i) {
    metrics[metrics_[i].name] = sums_[i] / static_cast<double>(examples());
  }
  SetRatios(metrics);
  const Eigen::VectorXd usage = set_.actions().MeanProbability();
  report.mutable_action_usage()->Add(usage.begin(), usage.end());
  AddReliability(set_.actions(), report);
  AddStrata(report);
  AddActionUses(set_.actions(), report);
  set_.Write(report);
  *report.mutable_input_ranges() = input_ranges_;
  return report;
}

}  // namespace maneuver::evaluation
