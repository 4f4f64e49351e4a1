#include "model/evaluation/anchor_report.h"

#include <string>

namespace maneuver::evaluation {
namespace {

void AddTo(std::optional<ActionStatistics>& statistics,
           const std::optional<AnchorMeasurement>& measured) {
  if (!measured) return;
  const Eigen::Index anchors = measured->probabilities.size();
  if (!statistics) statistics.emplace(static_cast<int>(anchors));
  statistics->Add(measured->probabilities, Eigen::VectorXd::Unit(anchors, measured->nearest));
}

void AddTo(std::optional<ActionStatistics>& statistics,
           const std::optional<ActionStatistics>& other) {
  if (!other) return;
  if (statistics) {
    statistics->Add(*other);
  } else {
    statistics = other;
  }
}

void WriteTo(v1::EvaluationReport& report, const std::string& prefix,
             const std::optional<ActionStatistics>& statistics) {
  if (!statistics) return;
  auto& metrics = *report.mutable_metrics();
  metrics[prefix + "effective_actions"] = statistics->EffectiveActions();
  metrics[prefix + "largest_share"] = statistics->MeanProbability().maxCoeff();
  metrics[prefix + "action_perplexity"] = statistics->Perplexity();
  metrics[prefix + "mutual_information"] = statistics->MutualInformation();
  metrics[prefix + "calibration_error"] = statistics->ExpectedCalibrationError();
}

}  // namespace

void AnchorStatistics::Add(const Measurement& measured) {
  AddTo(covernet_, measured.covernet);
  AddTo(multipath_, measured.multipath);
}

void AnchorStatistics::Add(const AnchorStatistics& other) {
  AddTo(covernet_, other.covernet_);
  AddTo(multipath_, other.multipath_);
}

void AnchorStatistics::Write(v1::EvaluationReport& report) const {
  WriteTo(report, "covernet_", covernet_);
  WriteTo(report, "multipath_", multipath_);
}

}  // namespace maneuver::evaluation
