#ifndef MANEUVER_MODEL_LEARNING_PHASES_POSTERIOR_H_
#define MANEUVER_MODEL_LEARNING_PHASES_POSTERIOR_H_

#include "absl/status/status.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"

namespace maneuver::learning {

inline constexpr char kPosteriorPhase[] = "posterior";

// Learns q(z|y,s) alone, by the model's own objective; all else is held fixed. Of a base model,
// q(z|y,s) becomes the generic action, and nothing is learned. Errors are those of EpochLoop::Run.
absl::Status TrainScenarioEncoders(LearningState& state, EpochLoop& loop);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_POSTERIOR_H_
