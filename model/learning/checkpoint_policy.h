#ifndef MANEUVER_MODEL_LEARNING_CHECKPOINT_POLICY_H_
#define MANEUVER_MODEL_LEARNING_CHECKPOINT_POLICY_H_

#include <chrono>
#include <cstdint>

namespace maneuver::learning {

// When a checkpoint is due, and how many are kept.
struct CheckpointPolicy {
  // The least time between two checkpoints; 0: a checkpoint at every step.
  std::chrono::milliseconds interval{60'000};
  // A checkpoint is also due this many steps after the last one, even before `interval` has passed;
  // 0: only `interval` counts.
  int64_t steps = 0;
  int kept = 2;  // number of checkpoints, the newest ones
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_CHECKPOINT_POLICY_H_
