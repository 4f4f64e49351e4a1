// Predicts the covariance of p(x|z,y,s) from the scene, and learns it (tensor.h, scene_covariance).

#ifndef MANEUVER_MODEL_LEARNING_SCENE_COVARIANCE_H_
#define MANEUVER_MODEL_LEARNING_SCENE_COVARIANCE_H_

#include "model/learning/networks.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Returns unit vectors along the mean trajectory of each action, [B, K, T, 2]. At a waypoint this
// is the direction of the mean step of all waypoints within 0.2 s of it. Where that mean is slower
// than 0.5 m/s, it is (1, 0).
//   means: [B, K, T, 2] metres, target frame, the reference included
//   interval: between two waypoints, seconds
at::Tensor MeanDirections(const at::Tensor& means, double interval);

// The covariance in two parts, without the speed factors: sigma_along^2 u u^T and sigma_across^2 n
// n^T, where u is the direction of `means` and n its left normal.
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
// Here e = x - m is the error of m, the trajectory that the mean of q(z|y,s) decodes to, with its
// residual. The directions d are those along and across r + m. Predictions for calibration
// (predictions.h) and the engine (inference/action_model.h) use the directions of r plus the mean
// of the decoded sigma points instead. The two means differ as far as the decoder is not linear.
// Only the covariance gets a gradient.
//   trajectories: relative to the reference, [B, 2T] metres
at::Tensor SceneCovarianceLoss(const Networks& networks, const SceneFeatures& scenes,
                               const at::Tensor& trajectories, const at::Tensor& references);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_SCENE_COVARIANCE_H_
