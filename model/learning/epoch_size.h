// How large the epochs of a run are.

#ifndef MANEUVER_MODEL_LEARNING_EPOCH_SIZE_H_
#define MANEUVER_MODEL_LEARNING_EPOCH_SIZE_H_

#include <algorithm>
#include <cstdint>

#include "maneuver/v1/training_settings.pb.h"

namespace maneuver::learning {

// Factor on the batch size in phases that learn from trajectories alone. Trajectories are small, so
// twice the batch takes the same time.
inline constexpr int64_t kTrajectoryBatchFactor = 2;
// Number of epochs that each placement of the mixture gets, if several are tried.
inline constexpr int kPlacementEpochs = 3;

// Number of steps over which the learning rate rises at the start.
inline constexpr int64_t kWarmUpSteps = 100;

// Returns the number of steps in an epoch of `examples` examples: at least one for two examples.
inline int64_t StepsOfEpoch(int64_t examples, int64_t batch_size) {
  // Leaves out a last batch of one example, because batch normalisation needs two.
  return examples / batch_size + (examples % batch_size > 1 ? 1 : 0);
}

// Returns how many of the training examples an epoch uses: at least two, if there are two.
//   settings: valid (artifact::ValidateTrainingSettings)
inline int64_t EpochExamples(const v1::TrainingSettings& settings, int64_t examples) {
  const int64_t most = settings.examples().max_examples();
  return most > 0 ? std::min(most, examples) : examples;
}

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_EPOCH_SIZE_H_
