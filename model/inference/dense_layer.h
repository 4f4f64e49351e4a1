// Fully connected layers, with ReLU or without.
//
// Each output is one chain of fused multiply-adds over the inputs in their order, whatever the
// number of rows: a row's answer has the same bits alone and in any batch. (Matrix products of
// oneDNN and Eigen choose kernels, and with them orders of summation, by the number of rows.)

#ifndef MANEUVER_MODEL_INFERENCE_DENSE_LAYER_H_
#define MANEUVER_MODEL_INFERENCE_DENSE_LAYER_H_

#include <Eigen/Core>
#include <span>
#include <vector>

namespace maneuver::inference {

enum class Activation { kNone, kRelu };

// y = W x + b. Immutable; safe to share between threads.
class DenseLayer {
 public:
  // weight: [outputs, inputs], row-major;  bias: [outputs]
  DenseLayer(int inputs, int outputs, const float* weight, const float* bias);

  int inputs() const { return inputs_; }
  int outputs() const { return outputs_; }
  size_t bytes() const {
    return sizeof(float) * static_cast<size_t>(panels_.size() + bias_.size());
  }

  // x: [rows, inputs];  y: [rows, outputs]; both row-major.
  void Apply(const float* x, int rows, Activation activation, float* y) const;

 private:
  int inputs_;
  int outputs_;
  // [ceil(outputs / P), inputs, P] with P outputs side by side, zero where there is no output.
  Eigen::ArrayXf panels_;
  Eigen::ArrayXf bias_;  // padded likewise
};

// Scratch of a stack of layers, for one thread.
struct MlpScratch {
  std::vector<float> front;
  std::vector<float> back;
};

// Layers with ReLU between them and none after the last. Immutable; safe to share between threads.
class Mlp {
 public:
  explicit Mlp(std::vector<DenseLayer> layers) : layers_(std::move(layers)) {}

  int inputs() const { return layers_.front().inputs(); }
  int outputs() const { return layers_.back().outputs(); }
  size_t bytes() const;

  // x: [rows, inputs];  y: [rows, outputs]; both row-major.
  void Apply(const float* x, int rows, MlpScratch* scratch, float* y) const;

 private:
  std::vector<DenseLayer> layers_;
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_DENSE_LAYER_H_
