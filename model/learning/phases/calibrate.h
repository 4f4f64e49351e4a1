#ifndef MANEUVER_MODEL_LEARNING_PHASES_CALIBRATE_H_
#define MANEUVER_MODEL_LEARNING_PHASES_CALIBRATE_H_

#include "absl/status/status.h"
#include "model/learning/calibration.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"

namespace maneuver::learning {

inline constexpr char kCalibratePhase[] = "calibrate";

// Calibrates probabilities and covariances (calibration.h). Writes no checkpoint: a run that is
// stopped here calibrates again. CANCELLED if the run is asked to stop.
absl::Status Calibrate(LearningState& state, EpochLoop& loop);

// Calibrates by at most so many examples, outside of any phase.
//   count: called after each step
absl::Status CalibrateBy(const CalibrationExamples& most, LearningState& state,
                         const CountCalibrationStep& count);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_CALIBRATE_H_
