// What a model predicts at each waypoint, as the engine answers it: deterministic, from sigma
// points.

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

// Of p(x|z) under latents [B, K, D], from the latent's mean and one standard deviation to either
// side along each dimension; without the decoder's own covariance, relative to the reference.
//   residual: Networks::MeanResidual of the scenes, [B, K, 2M], or undefined
WaypointMoments LatentMoments(const Networks& networks, const Gaussian& latents,
                              const at::Tensor& residual);

// Squared Mahalanobis distance of each waypoint under each action. [B, K, T]; arguments as below
at::Tensor SquaredDistances(const at::Tensor& mean, const at::Tensor& covariance,
                            const at::Tensor& trajectories);

// ln of each action's Gaussian at each waypoint. [B, K, T]; arguments as below
at::Tensor WaypointLogDensities(const at::Tensor& mean, const at::Tensor& covariance,
                                const at::Tensor& trajectories);

// ln of the mixture over actions of Gaussians at each waypoint. [B, T]
//   log_probabilities: [B, K];  covariance: positive definite
//   trajectories: [B, 2T] metres
at::Tensor WaypointLogLikelihood(const at::Tensor& log_probabilities, const at::Tensor& mean,
                                 const at::Tensor& covariance, const at::Tensor& trajectories);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_MOMENTS_H_
