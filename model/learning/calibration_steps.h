// Counts the steps of a calibration, for its progress.

#ifndef MANEUVER_MODEL_LEARNING_CALIBRATION_STEPS_H_
#define MANEUVER_MODEL_LEARNING_CALIBRATION_STEPS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>

#include "model/learning/training_progress.h"

namespace maneuver::learning {

// The kinds of steps. Those of one kind take about equally long in one calibration. Their values
// are the numbers of the kinds in the plan (TrainingProgress::Phase).
enum class CalibrationStep {
  kEncode,   // encodes a batch of scenes
  kPredict,  // predicts a batch
  kFit,      // fits a covariance to predictions of all actions
  kScale,    // fits a scale to predictions of each example's own actions
};
inline constexpr size_t kCalibrationStepKinds = 4;

// Called after each step, with the number of its examples. May be empty.
using CountCalibrationStep = std::function<void(CalibrationStep kind, int64_t examples)>;

// The steps of one kind in a calibration.
struct PlannedSteps {
  int64_t count = 0;
  int64_t examples = 0;  // of a step
};
using CalibrationPlan = std::array<PlannedSteps, kCalibrationStepKinds>;

inline PlannedSteps& StepsOfKind(CalibrationPlan& plan, CalibrationStep kind) {
  return plan[static_cast<size_t>(kind)];
}
inline const PlannedSteps& StepsOfKind(const CalibrationPlan& plan, CalibrationStep kind) {
  return plan[static_cast<size_t>(kind)];
}

// Returns the number of batches that contain all examples. The last one may be smaller.
inline int64_t BatchesOf(int64_t examples, int64_t batch_size) {
  return (examples + batch_size - 1) / batch_size;
}

// Returns the phase of a run that takes these steps.
//   encode_cost: cost of encoding a batch; the other kinds get about what they take beside it
TrainingProgress::Phase CalibrationPhase(const std::string& name, const CalibrationPlan& plan,
                                         double encode_cost);

// Counts the steps of a calibration as those of the present phase. `progress` must outlive it.
CountCalibrationStep StepsOf(TrainingProgress& progress);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_CALIBRATION_STEPS_H_
