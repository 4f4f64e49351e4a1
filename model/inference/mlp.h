// Stacks of fully connected layers.

#ifndef MANEUVER_MODEL_INFERENCE_MLP_H_
#define MANEUVER_MODEL_INFERENCE_MLP_H_

#include <cstddef>
#include <utility>
#include <vector>

#include "model/kernels/dense_layer.h"

namespace maneuver::inference {

using kernels::Activation;
using kernels::DenseLayer;
using kernels::DenseScratch;

// Scratch of a stack of layers. Each thread needs its own.
struct MlpScratch {
  DenseScratch dense;
  std::vector<float> front;
  std::vector<float> back;
};

// Layers with a ReLU after each but the last. Immutable; safe to share between threads.
class Mlp {
 public:
  explicit Mlp(std::vector<DenseLayer> layers) : layers_(std::move(layers)) {}

  int inputs() const { return layers_.front().inputs(); }
  int outputs() const { return layers_.back().outputs(); }
  const std::vector<DenseLayer>& layers() const { return layers_; }
  size_t bytes() const;

  // Applies the layers.
  //   x: [rows, inputs];  y: [rows, outputs]; both row-major
  void Apply(const float* x, int rows, MlpScratch* scratch, float* y) const;

 private:
  std::vector<DenseLayer> layers_;
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_MLP_H_
