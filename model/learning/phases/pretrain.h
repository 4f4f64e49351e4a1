#ifndef MANEUVER_MODEL_LEARNING_PHASES_PRETRAIN_H_
#define MANEUVER_MODEL_LEARNING_PHASES_PRETRAIN_H_

#include "absl/status/status.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"

namespace maneuver::learning {

inline constexpr char kPretrainPhase[] = "pretrain";

// Learns q(z|x) and p(x|z) as a plain variational autoencoder with p(z) = N(0, I). Errors are those
// of EpochLoop::Run.
absl::Status Pretrain(LearningState& state, EpochLoop& loop);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_PRETRAIN_H_
