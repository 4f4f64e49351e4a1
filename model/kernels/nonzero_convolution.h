// Convolves the nonzero values of a raster: for training, where weights change in every step and
// get gradients. All instruction sets give the same bits.

#ifndef MANEUVER_MODEL_KERNELS_NONZERO_CONVOLUTION_H_
#define MANEUVER_MODEL_KERNELS_NONZERO_CONVOLUTION_H_

#include <cstdint>

#include "model/kernels/nonzero_values.h"

namespace maneuver::kernels {

// Weights have room for a multiple of this number of outputs.
inline constexpr int64_t kNonzeroPadding = 8;

// Returns `outputs` rounded up to whole vectors.
constexpr int64_t PaddedOutputs(int64_t outputs) {
  return (outputs + kNonzeroPadding - 1) / kNonzeroPadding * kNonzeroPadding;
}

// A square kernel of odd size, padded by half of it, over [height, width, channels].
struct ConvolutionShape {
  int64_t height = 0;
  int64_t width = 0;
  int64_t channels = 0;
  int64_t outputs = 0;  // channels of the output
  int64_t kernel = 0;
  int64_t stride = 0;

  int64_t output_height() const { return (height - 1) / stride + 1; }
  int64_t output_width() const { return (width - 1) / stride + 1; }
};

// Writes the convolution's output.
//   raster: all channels of a raster of this shape
//   weight: [kernel, kernel, channels, PaddedOutputs(outputs)], divided by full intensity
//   output: [output_height, output_width, outputs]
void ConvolveNonzero(const ConvolutionShape& shape, const NonzeroValues& raster,
                     const float* weight, float* output);

// Accumulates dL/dweight from dL/doutput. `weight_gradient` is laid out as the weight.
//   gradient: dL/doutput, in the layout of the output
void AddNonzeroWeightGradient(const ConvolutionShape& shape, const NonzeroValues& raster,
                              const float* gradient, float* weight_gradient);

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_NONZERO_CONVOLUTION_H_
