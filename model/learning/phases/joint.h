#ifndef MANEUVER_MODEL_LEARNING_PHASES_JOINT_H_
#define MANEUVER_MODEL_LEARNING_PHASES_JOINT_H_

#include "absl/status/status.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"

namespace maneuver::learning {

inline constexpr char kJointPhase[] = "joint";

// Learns the unified objective of a unified model, and the base objective of any other. Errors are
// those of EpochLoop::Run.
absl::Status TrainJointly(LearningState& state, EpochLoop& loop);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_JOINT_H_
