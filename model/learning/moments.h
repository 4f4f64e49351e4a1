// Computes what a model predicts at each waypoint, as the engine does: without randomness, from
// sigma points.

#ifndef MANEUVER_MODEL_LEARNING_MOMENTS_H_
#define MANEUVER_MODEL_LEARNING_MOMENTS_H_

#include "model/learning/gaussian.h"
#include "model/learning/networks.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Means and covariances of waypoints, target frame.
struct WaypointMoments {
  at::Tensor mean;        // [B, K, T, 2] metres
  at::Tensor covariance;  // [B, K, T, 3] xx, xy, yy, square metres
};

// Returns the moments of p(x|z) under latents [B, K, D], from the latent's mean and one standard
// deviation to either side along each dimension. They are relative to the reference and leave out
// the decoder's own covariance.
//   residual: Networks::MeanResidual of the scenes, or undefined
WaypointMoments LatentMoments(const Networks& networks, const Gaussian& latents,
                              const at::Tensor& residual);

// In the functions below:
//   mean: [B, K, T, 2] metres;  covariance: [B, K, T, 3], positive definite
//   trajectories: [B, 2T] metres, measured from the same origin as `mean`

// Returns the squared Mahalanobis distance of each waypoint under each action. [B, K, T]
at::Tensor SquaredDistances(const at::Tensor& mean, const at::Tensor& covariance,
                            const at::Tensor& trajectories);

// Returns the log density of each action's Gaussian at each waypoint. [B, K, T] nats
at::Tensor WaypointLogDensities(const at::Tensor& mean, const at::Tensor& covariance,
                                const at::Tensor& trajectories);

// Returns the log density of the mixture over actions at each waypoint. [B, T] nats
//   log_probabilities: [B, K]
at::Tensor WaypointLogLikelihood(const at::Tensor& log_probabilities, const at::Tensor& mean,
                                 const at::Tensor& covariance, const at::Tensor& trajectories);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_MOMENTS_H_
