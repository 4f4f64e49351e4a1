// Learns and calibrates the covariance of p(x|z,y,s) that the scene predicts (tensor.h,
// scene_covariance).

#ifndef MANEUVER_MODEL_LEARNING_SCENE_COVARIANCE_H_
#define MANEUVER_MODEL_LEARNING_SCENE_COVARIANCE_H_

#include "model/learning/networks.h"
#include "model/learning/predictions.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Returns unit vectors along the mean trajectory of each action, [B, K, T, 2]. At a waypoint this
// is the direction of the mean step of all waypoints within 0.2 s of it. Where that mean is slower
// than 0.5 m/s, it is (1, 0).
//   means: [B, K, T, 2] metres, target frame, the reference included
//   interval: between two waypoints, seconds
at::Tensor MeanDirections(const at::Tensor& means, double interval);

// The covariance in two parts, without the speed factors: sigma_along^2 u u^T and sigma_across^2 n
// n^T, where u is the direction of the mean and n its left normal.
struct SplitCovariance {
  at::Tensor along;   // [B, K, T, 3] xx, xy, yy, square metres
  at::Tensor across;  // [B, K, T, 3] xx, xy, yy, square metres
};
// Predicts the covariance from the scene.
//   means: relative to the reference, [B, K, T, 2] metres
//   references: [B, 2T] metres
SplitCovariance PredictSceneCovariance(const Networks& networks, const SceneFeatures& scenes,
                                       const at::Tensor& means, const at::Tensor& references);

// Returns the loss of the covariance networks for each example, [B], nats per waypoint and
// direction:
//   sum_y q(y|x,s) mean_t sum_d (e_d^2 / (2 sigma_d^2) + ln sigma_d)
// Here e is the error of the mean of q(z|y,s), in the directions d along and across it. Only the
// covariance gets a gradient.
//   trajectories: relative to the reference, [B, 2T] metres
at::Tensor SceneCovarianceLoss(const Networks& networks, const SceneFeatures& scenes,
                               const at::Tensor& trajectories, const at::Tensor& references);

// Returns the bin of scene_covariance.speed_factor for each speed in m/s. [N]
at::Tensor SpeedBins(const at::Tensor& speeds);

// Returns the factors of the along and across variances for each speed bin, [6, 2], that make
// held-out trajectories most likely under the mixture over p(y|s). Bins with few examples are drawn
// towards the mean of all bins.
at::Tensor FitSpeedFactors(const Predictions& held_out);

// Returns `factors`, multiplied in each bin by the smallest number from 1 to 16 that makes the
// covered share at least `share` (CoveredShare in covariance_fit.h). A bin with fewer than 300
// examples uses the number for all examples together.
at::Tensor WidenToCoverBySpeed(const Predictions& held_out, const at::Tensor& factors,
                               double share);

// Returns the decoder's covariance with the speed factors applied. [N, K, T, 3] square metres
at::Tensor WithSpeedFactors(const Predictions& predictions, const at::Tensor& factors);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_SCENE_COVARIANCE_H_
