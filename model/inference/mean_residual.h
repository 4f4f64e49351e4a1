// The scene's contribution to the mean of p(x|z,y,s), beyond the decoder: a linear function of the
// scene.

#ifndef MANEUVER_MODEL_INFERENCE_MEAN_RESIDUAL_H_
#define MANEUVER_MODEL_INFERENCE_MEAN_RESIDUAL_H_

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/tensor.h"
#include "model/inference/mlp.h"

namespace maneuver::inference {

// Evaluates what tensor.h calls mean_residual. Computes in f32, because the result is metres.
// Immutable; safe to share between threads.
class MeanResidual {
 public:
  MeanResidual(const v1::ModelSpec& spec, const artifact::TensorMap& weights);

  size_t bytes() const;

  // Returns curves (scene_k f + geometry_k h_k), metres. [2T]
  //   features: [F] of the scene;  geometry: [A] h_k; null unless actions look at the lanes
  Eigen::RowVectorXd Evaluate(const float* features, const float* geometry, int k,
                              DenseScratch* scratch) const;

 private:
  std::vector<DenseLayer> scene_;     // [K] F -> 2M
  std::vector<DenseLayer> geometry_;  // [K] A -> 2M; empty unless actions look at the lanes
  DenseLayer curves_;                 // 2M -> 2T
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_MEAN_RESIDUAL_H_
