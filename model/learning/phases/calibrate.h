#ifndef MANEUVER_MODEL_LEARNING_PHASES_CALIBRATE_H_
#define MANEUVER_MODEL_LEARNING_PHASES_CALIBRATE_H_

#include "absl/status/status.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"

namespace maneuver::learning {

inline constexpr char kCalibratePhase[] = "calibrate";

// Fits probabilities and covariances to what they are worth (calibration.h). No checkpoint is
// written: a run that is stopped here calibrates again. CANCELLED if it is to stop.
absl::Status Calibrate(LearningState& state, EpochLoop& loop);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_CALIBRATE_H_
