#include "model/evaluation/anchor_report.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "model/evaluation/calibration.h"

namespace maneuver::evaluation {
namespace {

using Field = std::optional<AnchorMeasurement> Measurement::*;

void Add(std::span<const Measurement> measured, Field field, const std::string& prefix,
         bool measured_by_waymo, v1::EvaluationReport& report) {
  if (measured.empty() || !(measured.front().*field)) return;
  auto& metrics = *report.mutable_metrics();
  const auto set = [&](const std::string& name, auto value) {
    double sum = 0.0;
    for (const Measurement& each : measured) sum += static_cast<double>(value(*(each.*field)));
    metrics[prefix + name] = sum / static_cast<double>(measured.size());
  };
  for (size_t rank = 0; rank < kRanks.size(); ++rank) {
    const int k = kRanks[rank];
    const std::string best = k == 1 ? "" : "min_";
    const auto displacement = [rank](auto error) {
      return [rank, error](const AnchorMeasurement& m) { return m.displacement[rank].*error; };
    };
    set(absl::StrCat(best, "ade_", k), displacement(&DisplacementErrors::min_ade));
    set(absl::StrCat(best, "fde_", k), displacement(&DisplacementErrors::min_fde));
    set(absl::StrCat("brier_fde_", k), displacement(&DisplacementErrors::brier_fde));
    set(absl::StrCat("miss_rate_", k), displacement(&DisplacementErrors::missed_argoverse));
    set(absl::StrCat("miss_rate_nuscenes_", k), displacement(&DisplacementErrors::missed_nuscenes));
    if (measured_by_waymo) {
      set(absl::StrCat("miss_rate_waymo_", k),
          [rank](const AnchorMeasurement& m) { return m.waymo[rank].miss_rate; });
    }
  }
  set("nll", [](const AnchorMeasurement& m) { return m.nll.marginal; });
  set("nll_joint", [](const AnchorMeasurement& m) { return m.nll.joint; });

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

void AddAnchorMetrics(std::span<const Measurement> measured, bool measured_by_waymo,
                      v1::EvaluationReport& report) {
  Add(measured, &Measurement::covernet, "covernet_", measured_by_waymo, report);
  Add(measured, &Measurement::multipath, "multipath_", measured_by_waymo, report);
}

}  // namespace maneuver::evaluation
