// The covariance of p(x|z,y,s) as a function of the scene: along and across the predicted mean.

#ifndef MANEUVER_MODEL_INFERENCE_SCENE_COVARIANCE_H_
#define MANEUVER_MODEL_INFERENCE_SCENE_COVARIANCE_H_

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/tensor.h"
#include "model/inference/mlp.h"
#include "model/inference/trajectory_set.h"

namespace maneuver::inference {

// Evaluates the networks that tensor.h calls scene_covariance. Immutable; safe to share between
// threads.
class SceneCovariance {
 public:
  // Prepares the networks.
  //   bf16: the precision of the weights
  SceneCovariance(const v1::ModelSpec& spec, const artifact::TensorMap& weights, bool bf16);

  size_t bytes() const;

  // Returns the covariance of action `k` at each waypoint, target frame, square metres. [T, 3] xx,
  // xy, yy:
  //
  //   R^T diag(g_along sigma_along^2, g_across sigma_across^2) R
  //
  // with the rows of R the direction of the mean (MeanDirections) and its left normal, and g the
  // factors of the bin that |speed| falls in.
  //   features: [F] of the scene
  //   mean: [T, 2] of the action, target frame, metres, the reference included
  //   speed: speed of the target at the prediction time, m/s
  Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor> Evaluate(const float* features, int k,
                                                                     const Trajectory& mean,
                                                                     double speed,
                                                                     MlpScratch* scratch) const;

 private:
  std::vector<Mlp> networks_;  // [K] F -> 8
  // [T, kStddevTerms] 1, ln(2t/h), 2t/h - 1, e^-t
  Eigen::Matrix<double, Eigen::Dynamic, artifact::kStddevTerms, Eigen::RowMajor> terms_;
  Eigen::Matrix<double, artifact::kSpeedBinCount, 2, Eigen::RowMajor> factors_;
  double waypoint_interval_;  // seconds
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_SCENE_COVARIANCE_H_
