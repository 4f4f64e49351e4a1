#include "model/inference/mean_residual.h"

#include "model/inference/stored_layers.h"

namespace maneuver::inference {

MeanResidual::MeanResidual(const v1::ModelSpec& spec, const artifact::TensorMap& weights)
    : curves_([&] {
        const artifact::Tensor& curves = weights.at("mean_residual.curves");
        const std::vector<float> zeros(static_cast<size_t>(curves.shape[0]));
        return DenseLayer(static_cast<int>(curves.shape[1]), static_cast<int>(curves.shape[0]),
                          curves.values.data(), zeros.data());
      }()) {
  for (int k = 0; k < spec.actions(); ++k) {
    scene_.push_back(StoredLayerWithoutBias(weights, "mean_residual.scene", k));
    if (!spec.has_action_geometry()) continue;
    geometry_.push_back(StoredLayerWithoutBias(weights, "mean_residual.geometry", k));
  }
}

size_t MeanResidual::bytes() const {
  size_t bytes = curves_.bytes();
  for (const DenseLayer& layer : scene_) bytes += layer.bytes();
  for (const DenseLayer& layer : geometry_) bytes += layer.bytes();
  return bytes;
}

Eigen::RowVectorXd MeanResidual::Evaluate(const float* features, const float* geometry, int k,
                                          DenseScratch* scratch) const {
  const size_t action = static_cast<size_t>(k);
  Eigen::RowVectorXf coefficients(curves_.inputs());
  scene_[action].Apply(features, 1, Activation::kNone, scratch, coefficients.data());
  if (!geometry_.empty()) {
    Eigen::RowVectorXf terms(curves_.inputs());
    geometry_[action].Apply(geometry, 1, Activation::kNone, scratch, terms.data());
    coefficients += terms;
  }
  Eigen::RowVectorXf metres(curves_.outputs());
  curves_.Apply(coefficients.data(), 1, Activation::kNone, scratch, metres.data());
  return metres.cast<double>();
}

}  // namespace maneuver::inference
