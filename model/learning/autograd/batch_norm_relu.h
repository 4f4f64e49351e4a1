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

// Returns at::batch_norm(x) with the moments of x, and updates the running moments. A single cell
// has no unbiased variance, for which PyTorch would store NaN: running_var then stays as it is.
//   x: [B, C, h, w];  returns: the same shape
at::Tensor BatchNormOfBatch(const at::Tensor& x, const BatchNorm& norm);

// Returns max(0, BatchNormOfBatch(x)), and updates the running moments. On the CPU each direction
// takes two passes over memory and never stores the input of the ReLU.
//   x: [B, C, h, w];  returns: the same shape, channels last on the CPU
at::Tensor BatchNormRelu(const at::Tensor& x, const BatchNorm& norm);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_AUTOGRAD_BATCH_NORM_RELU_H_
