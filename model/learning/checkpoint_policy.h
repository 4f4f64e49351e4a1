#ifndef MANEUVER_MODEL_LEARNING_CHECKPOINT_POLICY_H_
#define MANEUVER_MODEL_LEARNING_CHECKPOINT_POLICY_H_

#include <chrono>
#include <cstdint>

namespace maneuver::learning {

// When a checkpoint is due, and how many are kept.
struct CheckpointPolicy {
  // The least time between two checkpoints; 0: one at every step.
  std::chrono::milliseconds interval{60'000};
  // A checkpoint is also due after this many steps, however short the time; 0: only by time.
  int64_t steps = 0;
  int kept = 2;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_CHECKPOINT_POLICY_H_
