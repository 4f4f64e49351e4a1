#include "model/learning/calibration_steps.h"

namespace maneuver::learning {
namespace {

// Costs relative to that of encoding a batch, where they are not measured.
constexpr double kPredictCost = 3.0;
constexpr double kFitCost = 1.0 / 150.0;           // of an example
constexpr double kScaleCost = 4.0 / 25.0 / 150.0;  // of an example, under 4 of 25 actions

}  // namespace

TrainingProgress::Phase CalibrationPhase(const std::string& name, const CalibrationPlan& plan,
                                         double encode_cost) {
  const PlannedSteps& fit = StepsOfKind(plan, CalibrationStep::kFit);
  const PlannedSteps& scale = StepsOfKind(plan, CalibrationStep::kScale);
  TrainingProgress::Phase phase{name, 1, StepsOfKind(plan, CalibrationStep::kEncode).count,
                                encode_cost};
  phase.others = {
      {StepsOfKind(plan, CalibrationStep::kPredict).count, kPredictCost * encode_cost},
      {fit.count, kFitCost * static_cast<double>(fit.examples) * encode_cost},
      {scale.count, kScaleCost * static_cast<double>(scale.examples) * encode_cost},
  };
  return phase;
}

CountCalibrationStep StepsOf(TrainingProgress& progress) {
  return [&progress](CalibrationStep kind, int64_t examples) {
    // Each example counts once for the rate at which they pass.
    progress.Step(kind == CalibrationStep::kEncode ? examples : 0, {}, static_cast<size_t>(kind));
  };
}

}  // namespace maneuver::learning
