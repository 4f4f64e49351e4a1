#ifndef MANEUVER_MODEL_LEARNING_PHASES_PLACE_H_
#define MANEUVER_MODEL_LEARNING_PHASES_PLACE_H_

#include <cstdint>

#include "absl/status/status.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"

namespace maneuver::learning {

inline constexpr char kPlacePhase[] = "place";

// Places the mixture p(z|y) as the settings say (mixture_placement.h), by at most 16,384 training
// examples (SpreadExamples). If several placements are tried, keeps the one with the best held-out
// base bound after a few epochs. Writes no checkpoint: a run that is stopped here places again.
// Errors are those of EpochLoop::Run.
absl::Status ChoosePlacement(LearningState& state, EpochLoop& loop);

// Returns the seed of a run's placement number `placement`, from 0. The first one has the run's own
// seed; no other run shares the rest.
uint64_t PlacementSeed(uint64_t seed, int placement);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_PLACE_H_
