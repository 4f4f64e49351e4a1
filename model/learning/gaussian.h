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

// Returns KL(q || p), nats, summed over the last dimension; the others broadcast.
at::Tensor Divergence(const Gaussian& q, const Gaussian& p);
// Returns H(q, p) = -E_q ln p, nats, summed over the last dimension; the others broadcast.
at::Tensor CrossEntropy(const Gaussian& q, const Gaussian& p);
// Returns a sample, z = mean + stddev * noise, with gradients to mean and variance.
//   noise: standard normal, of the mean's shape
at::Tensor Sample(const Gaussian& q, const at::Tensor& noise);
// Returns N(0, I) of D dimensions.
Gaussian StandardNormal(int64_t dimensions, at::Device device);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_GAUSSIAN_H_
