// Learns and calibrates the covariance of p(x|z,y,s) that the scene predicts (tensor.h,
// scene_covariance).

#ifndef MANEUVER_MODEL_LEARNING_SCENE_COVARIANCE_H_
#define MANEUVER_MODEL_LEARNING_SCENE_COVARIANCE_H_

#include "model/learning/networks.h"
#include "model/learning/predictions.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Unit vectors along the mean trajectory of each action: of its step to each waypoint, averaged
// over the waypoints within 0.2 s, or (1, 0) where that is slower than 0.5 m/s. [B, K, T, 2]
//   means: [B, K, T, 2] metres, target frame, the reference included
//   interval: between two waypoints, seconds
at::Tensor MeanDirections(const at::Tensor& means, double interval);

// The two parts of the covariance, without the factors of the speed: sigma_along^2 u u^T and
// sigma_across^2 n n^T, n the left of u.
struct SplitCovariance {
  at::Tensor along;   // [B, K, T, 3] xx, xy, yy, square metres
  at::Tensor across;  // [B, K, T, 3] xx, xy, yy, square metres
};
//   means: relative to the reference, [B, K, T, 2];  references: [B, 2T]
SplitCovariance PredictSceneCovariance(const Networks& networks, const SceneFeatures& scenes,
                                       const at::Tensor& means, const at::Tensor& references);

// What the networks of the covariance minimise, nats a waypoint and direction:
//   sum_y q(y|x,s) mean_t sum_d (e_d^2 / (2 sigma_d^2) + ln sigma_d),
// e the error of the mean of q(z|y,s), turned along and across it. Everything but the covariance is
// held fixed. [B]
//   trajectories: relative to the reference, [B, 2T]
at::Tensor SceneCovarianceLoss(const Networks& networks, const SceneFeatures& scenes,
                               const at::Tensor& trajectories, const at::Tensor& references);

// The bin of scene_covariance.speed_factor for each speed, m/s. [N]
at::Tensor SpeedBins(const at::Tensor& speeds);

// The factors of the two variances by bin, [6, 2], under which held-out trajectories are most
// likely (mixture over p(y|s)). Those of bins with few examples are drawn to the mean of all.
at::Tensor FitSpeedFactors(const Predictions& held_out);

// `factors`, those of each bin multiplied by the least number from 1 to 16 for which the share of
// waypoints within 2 sigma of the action that they are is at least `share`: the share of the bin's
// examples, or of all examples for a bin that has fewer than three hundred.
at::Tensor WidenToCoverBySpeed(const Predictions& held_out, const at::Tensor& factors,
                               double share);

// The decoder's covariance with the factors in it. [N, K, T, 3]
at::Tensor WithSpeedFactors(const Predictions& predictions, const at::Tensor& factors);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_SCENE_COVARIANCE_H_
