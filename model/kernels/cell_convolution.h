// A convolution with its ReLU at some cells of its output.
//
// In f32 each output is one chain of fused multiply-adds. Its order is the same for every cell and
// instruction set, so a cell has the same bits whichever other cells are computed.
//
// bf16 needs a processor with AVX-512 BF16, or the plain kernels. Inputs and weights are multiplied
// in pairs and summed in f32.

#ifndef MANEUVER_MODEL_KERNELS_CELL_CONVOLUTION_H_
#define MANEUVER_MODEL_KERNELS_CELL_CONVOLUTION_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "model/kernels/aligned_vector.h"

namespace maneuver::kernels {

// The shape of the layer.
struct CellShape {
  int kernel;   // k, rows and columns
  int inputs;   // C, channels
  int outputs;  // C', channels
  bool relu;
};

// A cell of the output: where its kernel begins in the input, and where its channels are in the
// output. Both are counted in values from the first.
struct Cell {
  ptrdiff_t input;
  ptrdiff_t output;
};

// What one implementation reads and writes. CellConvolution describes the layouts.
struct CellProblem {
  CellShape shape;
  ptrdiff_t row_values;  // from an input row to its next
  const void* input;     // floats or bf16
  const void* weights;   // floats or bf16
  const float* bias;     // [C']
  std::span<const Cell> cells;
  void* output;  // floats or bf16
};

// One implementation.
struct CellKernel {
  int lanes;                                // C' must be a multiple of it
  int (*together)(int outputs);             // G: how many of C' outputs are summed at a time
  bool (*has_bf16)();                       // on this processor
  void (*f32)(const CellProblem&);          // all are floats
  void (*bf16)(const CellProblem&);         // bf16 is read, floats are written
  void (*bf16_narrow)(const CellProblem&);  // bf16 is read and written
};

// Immutable; safe to share between threads.
class CellConvolution {
 public:
  // Returns whether the kernels in use can compute a layer with these channels: C' must fill
  // vectors, and C must fill pairs in bf16.
  static bool Supports(int inputs, int outputs, bool bf16);

  // Prepares a supported layer.
  //   weight: [C', C, k, k];  bias: [C']
  //   bf16: whether inputs and weights are bf16; products are summed in f32
  //   narrow: whether outputs are also bf16, rounded to the nearest, instead of floats
  CellConvolution(const CellShape& shape, std::span<const float> weight,
                  std::span<const float> bias, bool bf16, bool narrow);

  size_t bytes() const {
    return (wide_.size() + bias_.size()) * sizeof(float) + narrow_.size() * sizeof(uint16_t);
  }

  // Evaluates the given cells.
  //   input: [rows, row_values] with its padding;  row_values: from a row to its next
  //   output: [C'] for each cell, bf16 or floats
  void Evaluate(const void* input, ptrdiff_t row_values, std::span<const Cell> cells,
                void* output) const;

 private:
  CellShape shape_;
  void (*evaluate_)(const CellProblem&);  // of the kernel for which the weights are packed
  // [C' / G, k, k * C / step, G, step]: of G outputs at a time, the weights of one input after the
  // other (step 1), or of pairs of inputs in bf16 (step 2).
  AlignedVector<float> wide_;
  AlignedVector<uint16_t> narrow_;  // or, in bf16, these
  AlignedVector<float> bias_;       // [C']
};

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_CELL_CONVOLUTION_H_
