#ifndef MANEUVER_MODEL_LEARNING_PHASES_COVARIANCE_H_
#define MANEUVER_MODEL_LEARNING_PHASES_COVARIANCE_H_

#include "absl/status/status.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"

namespace maneuver::learning {

inline constexpr char kCovariancePhase[] = "covariance";

// Learns the covariance that the scene predicts (scene_covariance.h), if the model has one.
// Everything else stays fixed. Errors are those of EpochLoop::Run.
absl::Status TrainCovariance(LearningState& state, EpochLoop& loop);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_COVARIANCE_H_
