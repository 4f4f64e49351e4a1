// A fully connected layer, y = W x + b, with ReLU or without.
//
// Each output is one chain of fused multiply-adds over the inputs in their order, whatever the
// number of rows and whatever the instruction set. A row's answer has the same bits alone and in
// any batch. (Matrix products of oneDNN and Eigen choose an order of summation by the number of
// rows.)
//
// After a ReLU more than half of the inputs are 0. In similar rows, such as the sigma points of an
// action, they are the same inputs. The fast kernel skips inputs that are 0 in all rows of a small
// block, which changes no bit.

#ifndef MANEUVER_MODEL_KERNELS_DENSE_LAYER_H_
#define MANEUVER_MODEL_KERNELS_DENSE_LAYER_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "model/kernels/aligned_vector.h"

namespace maneuver::kernels {

enum class Activation { kNone, kRelu };

// Scratch of a layer. Each thread needs its own.
struct DenseScratch {
  std::vector<uint32_t> nonzero;  // [blocks of rows, inputs] the inputs that are not 0
  std::vector<size_t> counts;     // [blocks of rows] how many
};

// A layer's weights, in panels of P adjacent outputs; 0 beyond the last output.
struct DensePanels {
  int inputs;
  int outputs;
  AlignedVector<float> wide;       // [ceil(outputs / P), inputs, P]
  AlignedVector<uint16_t> narrow;  // or, in bf16, these
  AlignedVector<float> bias;       // [ceil(outputs / P), P]
};

// One implementation.
struct DenseKernel {
  int panel;  // P
  void (*apply)(const DensePanels& panels, const float* x, int rows, Activation activation,
                DenseScratch* scratch, float* y);
};

// Immutable; safe to share between threads.
class DenseLayer {
 public:
  // Packs the weights.
  //   weight: [outputs, inputs], row-major;  bias: [outputs]
  //   bf16: rounds the weights to bf16, which halves the memory to read; the arithmetic stays f32
  DenseLayer(int inputs, int outputs, const float* weight, const float* bias, bool bf16 = false);

  int inputs() const { return panels_.inputs; }
  int outputs() const { return panels_.outputs; }
  size_t bytes() const {
    return sizeof(float) * (panels_.wide.size() + panels_.bias.size()) +
           sizeof(uint16_t) * panels_.narrow.size();
  }

  // x: [rows, inputs];  y: [rows, outputs]; both row-major.
  void Apply(const float* x, int rows, Activation activation, DenseScratch* scratch,
             float* y) const {
    kernel_->apply(panels_, x, rows, activation, scratch, y);
  }

 private:
  const DenseKernel* kernel_;  // for which the weights are packed
  DensePanels panels_;
};

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_DENSE_LAYER_H_
