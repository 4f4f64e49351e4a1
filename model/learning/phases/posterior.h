#ifndef MANEUVER_MODEL_LEARNING_PHASES_POSTERIOR_H_
#define MANEUVER_MODEL_LEARNING_PHASES_POSTERIOR_H_

#include "absl/status/status.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"

namespace maneuver::learning {

inline constexpr char kPosteriorPhase[] = "posterior";

// Learns only q(z|y,s), by the model's own objective; everything else stays fixed. For a base
// model, learns nothing: q(z|y,s) becomes the generic action. Errors are those of EpochLoop::Run.
absl::Status TrainScenarioEncoders(LearningState& state, EpochLoop& loop);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_POSTERIOR_H_
