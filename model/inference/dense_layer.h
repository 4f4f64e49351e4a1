// Fully connected layers, with ReLU or without.
//
// Each output is one chain of fused multiply-adds over the inputs in their order, whatever the
// number of rows: a row's answer has the same bits alone and in any batch. (Matrix products of
// oneDNN and Eigen choose kernels, and with them orders of summation, by the number of rows.)
//
// After a ReLU more than half of the inputs are 0, and in rows that are alike, such as the sigma
// points of an action, the same ones. Inputs that are 0 in all of a few rows are passed over, which
// changes no bit.

#ifndef MANEUVER_MODEL_INFERENCE_DENSE_LAYER_H_
#define MANEUVER_MODEL_INFERENCE_DENSE_LAYER_H_

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace maneuver::inference {

enum class Activation { kNone, kRelu };

// Scratch of a layer, for one thread.
struct DenseScratch {
  std::vector<uint32_t> bits;    // [inputs]
  std::vector<uint32_t> filled;  // [blocks of rows, inputs] those that are not 0
  std::vector<size_t> counts;    // [blocks of rows] how many
};

// y = W x + b. Immutable; safe to share between threads.
class DenseLayer {
 public:
  // weight: [outputs, inputs], row-major;  bias: [outputs]
  //   bf16: weights are rounded to it, which halves what has to come from memory; the arithmetic
  //         is f32 all the same
  DenseLayer(int inputs, int outputs, const float* weight, const float* bias, bool bf16 = false);

  int inputs() const { return inputs_; }
  int outputs() const { return outputs_; }
  size_t bytes() const {
    return sizeof(float) * static_cast<size_t>(panels_.size() + bias_.size()) +
           sizeof(Eigen::bfloat16) * static_cast<size_t>(narrow_panels_.size());
  }

  // x: [rows, inputs];  y: [rows, outputs]; both row-major.
  void Apply(const float* x, int rows, Activation activation, DenseScratch* scratch,
             float* y) const;

 private:
  int inputs_;
  int outputs_;
  // [ceil(outputs / P), inputs, P] with P outputs side by side, zero where there is no output.
  Eigen::ArrayXf panels_;
  Eigen::Array<Eigen::bfloat16, Eigen::Dynamic, 1> narrow_panels_;  // or, in bf16, these
  Eigen::ArrayXf bias_;                                             // padded likewise
};

// Scratch of a stack of layers, for one thread.
struct MlpScratch {
  DenseScratch dense;
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
