#include "model/evaluation/anchor_report.h"

#include <string>

#include "model/evaluation/calibration.h"

namespace maneuver::evaluation {
namespace {

using Field = std::optional<AnchorMeasurement> Measurement::*;

void Add(std::span<const Measurement> measured, Field field, const std::string& prefix,
         v1::EvaluationReport& report) {
  if (measured.empty() || !(measured.front().*field)) return;
  auto& metrics = *report.mutable_metrics();
  const Eigen::Index anchors = (measured.front().*field)->probabilities.size();
  ActionStatistics statistics(static_cast<int>(anchors));
  for (const Measurement& each : measured) {
    const AnchorMeasurement& m = *(each.*field);
    statistics.Add(m.probabilities, Eigen::VectorXd::Unit(anchors, m.nearest));
  }
  metrics[prefix + "effective_actions"] = statistics.EffectiveActions();
  metrics[prefix + "largest_share"] = statistics.MeanProbability().maxCoeff();
  metrics[prefix + "action_perplexity"] = statistics.Perplexity();
  metrics[prefix + "mutual_information"] = statistics.MutualInformation();
  metrics[prefix + "calibration_error"] = statistics.ExpectedCalibrationError();
}

}  // namespace

void AddAnchorMetrics(std::span<const Measurement> measured, v1::EvaluationReport& report) {
  Add(measured, &Measurement::covernet, "covernet_", report);
  Add(measured, &Measurement::multipath, "multipath_", report);
}

}  // namespace maneuver::evaluation
