// A fully connected layer of pairs of points, relative to the point between them.
//
// Let x be a point and x+, x- a pair beside it:
//
//   h = (x+ - x-) / 2            half the difference
//   q = (x+ + x-) / 2 - x        half the second difference, so that x+ = x + q + h, x- = x + q - h
//
// A layer y = W x + b maps h to W h and q to W q. A ReLU maps both to 0 where it cuts off all three
// points, and leaves them where it cuts off none. So q is 0 wherever the network is linear.
//
// bf16 keeps two digits. It rounds a difference of 1 m by millimetres, and would round a point at
// 50 m by decimetres.

#ifndef MANEUVER_MODEL_KERNELS_DIFFERENCE_LAYER_H_
#define MANEUVER_MODEL_KERNELS_DIFFERENCE_LAYER_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "model/kernels/aligned_vector.h"

namespace maneuver::kernels {

// Scratch of a layer. Each thread needs its own.
struct DifferenceScratch {
  std::vector<uint32_t> nonzero;  // [inputs] those that are not 0 in all rows of a block
  std::vector<uint16_t> narrow;   // [rows, inputs] those inputs, bf16
};

// What one implementation reads and writes.
struct DifferenceProblem {
  int inputs;
  int outputs;
  const uint16_t* weights;  // [ceil(outputs / P), inputs, P] bf16, in the kernel's order
  const float* x;           // [rows, inputs]
  int rows;
  float* y;  // [rows, outputs]
};

// One implementation.
struct DifferenceKernel {
  int panel;                 // P, outputs that are packed together
  int (*place)(int output);  // of an output in its panel
  bool (*is_there)();        // on this processor
  void (*apply)(const DifferenceProblem& problem, DifferenceScratch* scratch);
};

// y = W x. Weights and inputs are bf16; products are summed in f32. Immutable; safe to share
// between threads.
class DifferenceLayer {
 public:
  // Returns whether the kernels in use can compute such layers: the plain ones, and those of a
  // processor with AVX-512 BF16.
  static bool Supported();

  // Packs the weights of a supported layer.
  //   weight: [outputs, inputs], row-major
  DifferenceLayer(int inputs, int outputs, const float* weight);

  int outputs() const { return outputs_; }
  size_t bytes() const { return weights_.size() * sizeof(uint16_t); }

  // Inputs that are 0 in all rows of a small block cost nothing. The other inputs are summed in
  // pairs, so a row's last bits depend on which rows are given with it.
  //   x: [rows, inputs];  y: [rows, outputs]; both row-major
  void Apply(const float* x, int rows, DifferenceScratch* scratch, float* y) const {
    kernel_->apply({.inputs = inputs_,
                    .outputs = outputs_,
                    .weights = weights_.data(),
                    .x = x,
                    .rows = rows,
                    .y = y},
                   scratch);
  }

 private:
  const DifferenceKernel* kernel_;  // for which the weights are packed
  int inputs_;
  int outputs_;
  AlignedVector<uint16_t> weights_;
};

// Passes pairs and the point between them through a ReLU, in place.
//   x: [width];  h, q: [pairs, width]
void RectifyDifferences(int width, int pairs, float* x, float* h, float* q);

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_DIFFERENCE_LAYER_H_
