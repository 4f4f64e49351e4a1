// A convolution with its ReLU at some cells of its output.
//
// In f32 each output is one chain of fused multiply-adds, in the same order whatever the cell, its
// company and the instruction set: the answer for a cell has the same bits, whichever others are
// computed. bf16 inputs and weights are multiplied in pairs, where the processor has an instruction
// for that (AVX-512 BF16), and summed in f32.

#ifndef MANEUVER_MODEL_KERNELS_CELL_CONVOLUTION_H_
#define MANEUVER_MODEL_KERNELS_CELL_CONVOLUTION_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "model/kernels/aligned_vector.h"

namespace maneuver::kernels {

// Of the layer.
struct CellShape {
  int kernel;   // k, rows and columns
  int inputs;   // C, channels
  int outputs;  // C', channels
  bool relu;
};

// A cell of the output, in values from the first: where its kernel begins in the input, and where
// its channels are in the output.
struct Cell {
  ptrdiff_t input;
  ptrdiff_t output;
};

// What one implementation reads and writes; CellConvolution says how it is laid out.
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
  int lanes;                                // C' must be a multiple
  int (*together)(int outputs);             // G: how many of C' outputs are summed at a time
  bool (*has_bf16)();                       // on this processor
  void (*f32)(const CellProblem&);          // all are floats
  void (*bf16)(const CellProblem&);         // bf16 is read, floats are written
  void (*bf16_narrow)(const CellProblem&);  // bf16 is read and written
};

// Immutable; safe to share between threads.
class CellConvolution {
 public:
  // Whether the kernels in force can compute a layer with so many channels: C' has to fill vectors,
  // and C pairs in bf16.
  static bool Supports(int inputs, int outputs, bool bf16);

  // A layer that is supported.
  //   weight: [C', C, k, k];  bias: [C']
  //   bf16: the precision of inputs and weights; products are summed in f32
  //   narrow: outputs are bf16 as well, rounded to the nearest; floats otherwise
  CellConvolution(const CellShape& shape, std::span<const float> weight,
                  std::span<const float> bias, bool bf16, bool narrow);

  size_t bytes() const {
    return (wide_.size() + bias_.size()) * sizeof(float) + narrow_.size() * sizeof(uint16_t);
  }

  //   input: [rows, row_values] with the padding around it;  row_values: from a row to its next
  //   output: of each cell [C'], bf16 or floats
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
