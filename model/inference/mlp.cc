#include "model/inference/mlp.h"

namespace maneuver::inference {

size_t Mlp::bytes() const {
  size_t bytes = 0;
  for (const DenseLayer& layer : layers_) bytes += layer.bytes();
  return bytes;
}

void Mlp::Apply(const float* x, int rows, MlpScratch* scratch, float* y) const {
  for (size_t i = 0; i + 1 < layers_.size(); ++i) {
    scratch->back.resize(static_cast<size_t>(rows) * static_cast<size_t>(layers_[i].outputs()));
    layers_[i].Apply(x, rows, Activation::kRelu, &scratch->dense, scratch->back.data());
    std::swap(scratch->front, scratch->back);
    x = scratch->front.data();
  }
  layers_.back().Apply(x, rows, Activation::kNone, &scratch->dense, y);
}

}  // namespace maneuver::inference
