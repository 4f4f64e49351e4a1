// Batch normalisation while training, with a ReLU after it.

#ifndef MANEUVER_MODEL_LEARNING_AUTOGRAD_BATCH_NORM_RELU_H_
#define MANEUVER_MODEL_LEARNING_AUTOGRAD_BATCH_NORM_RELU_H_

#include "model/learning/tensors.h"

namespace maneuver::learning {

struct BatchNorm {
  at::Tensor weight;        // [C]
  at::Tensor bias;          // [C]
  at::Tensor running_mean;  // [C]
  at::Tensor running_var;   // [C], unbiased
};
inline constexpr double kBatchNormMomentum = 0.1;
inline constexpr double kBatchNormEpsilon = 1e-5;  // artifact/tensor.h

// max(0, at::batch_norm of x by its own moments), which the running ones follow. On the processor
// it takes two passes over memory each way, and what comes before the ReLU is never stored.
//   x: [B, C, h, w]; returns: the same, channels last on the processor
at::Tensor BatchNormRelu(const at::Tensor& x, const BatchNorm& norm);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_AUTOGRAD_BATCH_NORM_RELU_H_
