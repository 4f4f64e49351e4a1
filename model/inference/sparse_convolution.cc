#include "model/inference/sparse_convolution.h"

#include <algorithm>

namespace maneuver::inference {

bool SparseConvolution::Supports(const artifact::BackboneLayer& layer) {
  return layer.kind == artifact::BackboneLayer::Kind::kConvolution && !layer.adds &&
         layer.output.channels % kernels::FirstLayerKernelInForce().lanes == 0;
}

SparseConvolution::SparseConvolution(const artifact::BackboneLayer& layer,
                                     const FoldedConvolution& folded)
    : kernel_(kernels::FirstLayerKernelInForce()), layer_(layer) {
  const int inputs = layer.input.channels;
  const int outputs = layer.output.channels;
  const int taps = layer.kernel * layer.kernel;
  weights_.resize(static_cast<size_t>(taps) * inputs * outputs);
  for (int o = 0; o < outputs; ++o) {
    for (int i = 0; i < inputs; ++i) {
      for (int tap = 0; tap < taps; ++tap) {
        weights_[(static_cast<size_t>(tap) * inputs + i) * outputs + o] =
            folded.weight[(static_cast<size_t>(o) * inputs + i) * taps + tap];
      }
    }
  }
}

void SparseConvolution::AddTap(const kernels::NonzeroValues& values, int row, int tap,
                               float* sums) const {
  const int kernel = layer_.kernel;
  const int stride = layer_.stride;
  const int channels = layer_.output.channels;
  for (int p = values.rows[row]; p < values.rows[row + 1]; ++p) {
    const kernels::NonzeroValues::Pixel& pixel = values.pixels[p];
    const int from_left = pixel.column + kernel / 2;
    for (int column_tap = from_left % stride; column_tap < kernel; column_tap += stride) {
      const int column = (from_left - column_tap) / stride;
      if (from_left < column_tap || column >= layer_.output.width) continue;
      const float* weights =
          weights_.data() + ptrdiff_t{tap * kernel + column_tap} * layer_.input.channels * channels;
      kernel_.add_values({values.values.data() + pixel.begin, values.values.data() + pixel.end},
                         pixel.column * layer_.input.channels, weights, channels,
                         sums + static_cast<size_t>(column) * channels);
    }
  }
}

void SparseConvolution::AddRow(const kernels::NonzeroValues& values, int row, float* sums) const {
  const int top = row * layer_.stride - layer_.kernel / 2;
  const int first = std::max(0, -top);
  const int last = std::min(layer_.kernel, layer_.input.height - top);
  for (int tap = first; tap < last; ++tap) AddTap(values, top + tap, tap, sums);
}

}  // namespace maneuver::inference
