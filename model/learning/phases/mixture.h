#ifndef MANEUVER_MODEL_LEARNING_PHASES_MIXTURE_H_
#define MANEUVER_MODEL_LEARNING_PHASES_MIXTURE_H_

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"

namespace maneuver::learning {

inline constexpr char kMixturePhase[] = "mixture";

// Learns the base objective with a p(y) that does not depend on the scenario. With a prior on the
// weights (dirichlet_weights.h), then switches off the actions that are not needed. Errors are
// those of EpochLoop::Run.
absl::Status TrainMixture(LearningState& state, EpochLoop& loop);

// Learns the same for `epochs` epochs as a part of `phase`, which the caller has begun, without
// checkpoints. Returns the held-out loss of the last epoch, or the training loss if no examples are
// held out; infinity without epochs.
absl::StatusOr<double> TryMixture(const std::string& phase, int epochs, LearningState& state,
                                  EpochLoop& loop);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_MIXTURE_H_
