#ifndef MANEUVER_MODEL_LEARNING_CHECKPOINT_POLICY_H_
#define MANEUVER_MODEL_LEARNING_CHECKPOINT_POLICY_H_

#include <chrono>
#include <cstdint>

namespace maneuver::learning {

// When a checkpoint is due, and how many are kept.
struct CheckpointPolicy {
  // Least time between two; 0: at every step.
  std::chrono::milliseconds interval{60'000};
  // One is due after so many steps as well, however short the time; 0: by time alone.
  int64_t steps = 0;
  int kept = 2;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_CHECKPOINT_POLICY_H_
