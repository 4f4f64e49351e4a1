// The loss of one step.

#ifndef MANEUVER_MODEL_LEARNING_PHASES_BATCH_LOSS_H_
#define MANEUVER_MODEL_LEARNING_PHASES_BATCH_LOSS_H_

#include <chrono>
#include <cstdint>

#include "model/learning/tensors.h"

namespace maneuver::learning {

// The loss of a batch, or of a micro-batch, to be minimised.
struct BatchLoss {
  at::Tensor value;  // a scalar with its graph
  int64_t examples = 0;
  std::chrono::nanoseconds waited{0};  // time that the step waited for its rasters
  double share = 1.0;                  // of the batch's examples that are in this micro-batch
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_BATCH_LOSS_H_
