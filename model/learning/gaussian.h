// Diagonal Gaussians over z as tensors.

#ifndef MANEUVER_MODEL_LEARNING_GAUSSIAN_H_
#define MANEUVER_MODEL_LEARNING_GAUSSIAN_H_

#include "model/learning/tensors.h"

namespace maneuver::learning {

// Batches of Gaussians with diagonal covariance; the last dimension is D.
struct Gaussian {
  at::Tensor mean;          // [..., D]
  at::Tensor log_variance;  // [..., D]
};

// KL(q || p), nats, over the last dimension; the others broadcast.
at::Tensor Divergence(const Gaussian& q, const Gaussian& p);
// H(q, p) = -E_q ln p, nats, likewise.
at::Tensor CrossEntropy(const Gaussian& q, const Gaussian& p);
// A sample with gradients to mean and variance, z = mean + stddev * noise.
//   noise: standard normal, of the mean's shape
at::Tensor Sample(const Gaussian& q, const at::Tensor& noise);
// N(0, I) of D dimensions.
Gaussian StandardNormal(int64_t dimensions, at::Device device);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_GAUSSIAN_H_
