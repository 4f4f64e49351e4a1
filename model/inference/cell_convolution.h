// A convolution with its ReLU at some cells of its output, eight or so at a time.
//
// Each output is one chain of multiply-adds, in the same order whatever the cell and its company:
// the answer for a cell is the same to the bit, whichever others are computed.

#ifndef MANEUVER_MODEL_INFERENCE_CELL_CONVOLUTION_H_
#define MANEUVER_MODEL_INFERENCE_CELL_CONVOLUTION_H_

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "model/artifact/backbone_layers.h"
#include "model/inference/folded_convolution.h"

namespace maneuver::inference {

// Immutable; safe to share between threads.
class CellConvolution {
 public:
  // A cell of the output, in values from the first: where its kernel begins in the input, and where
  // its channels are in the output.
  struct Cell {
    ptrdiff_t input;
    ptrdiff_t output;
  };

  // Whether there is one for a layer and a precision in this build: its channels have to fill
  // vectors.
  static bool Takes(const artifact::BackboneLayer& layer, bool bf16);

  //   bf16: the precision of inputs and weights; products are summed in f32
  //   narrow: outputs are bf16 as well; floats otherwise
  CellConvolution(const artifact::BackboneLayer& layer, const FoldedConvolution& folded, bool bf16,
                  bool narrow);

  size_t bytes() const;

  //   input: [rows, row_values] with the padding around it;  row_values: from a row to its next
  //   output: of each cell [C'], bf16 or floats
  void Evaluate(const void* input, ptrdiff_t row_values, std::span<const Cell> cells,
                void* output) const;

 private:
  const artifact::BackboneLayer layer_;
  const bool bf16_;
  const bool narrow_;
  // [C' / vectors, k, k * C / step, vectors, step]: of a few vectors of outputs at a time, those of
  // one input after the other, in pairs if they are bf16.
  Eigen::ArrayXf weights_;
  Eigen::Array<Eigen::bfloat16, Eigen::Dynamic, 1> narrow_weights_;
  Eigen::ArrayXf bias_;  // [C']
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_CELL_CONVOLUTION_H_
