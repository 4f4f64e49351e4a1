#include "model/inference/map_convolution.h"

#include <algorithm>

namespace maneuver::inference {

bool MapConvolution::Supports(const artifact::BackboneLayer& layer) {
  return layer.kind == artifact::BackboneLayer::Kind::kConvolution && !layer.adds &&
         layer.kernel > 1 && layer.kernel <= kernels::kMostMapRows &&
         layer.input.channels > kChannels &&
         layer.output.channels % kernels::FirstLayerKernelInForce().lanes == 0;
}

MapConvolution::MapConvolution(const artifact::BackboneLayer& layer,
                               const FoldedConvolution& folded)
    : kernel_(kernels::FirstLayerKernelInForce()),
      layer_(layer),
      row_pixels_(static_cast<size_t>(layer.input.width + layer.kernel)),
      bias_(folded.bias.begin(), folded.bias.end()) {
  for (int tap = 0; tap < layer.kernel; ++tap) {
    for (int channel = 0; channel < kChannels; ++channel) {
      places_.push_back(channel * static_cast<int>(row_pixels_) + tap);
    }
  }
  const int taps = layer.kernel * layer.kernel;
  for (int tap = 0; tap < taps; ++tap) {
    for (int i = 0; i < kChannels; ++i) {
      for (int o = 0; o < layer.output.channels; ++o) {
        weights_.push_back(
            folded.weight[(static_cast<size_t>(o) * layer.input.channels + i) * taps + tap]);
      }
    }
  }
}

void MapConvolution::Begin(Rows* rows) const {
  const size_t kernel = static_cast<size_t>(layer_.kernel);
  rows->values.assign(row_pixels_ * kChannels * kernel, 0.0F);  // the padding stays
  rows->held.assign(kernel, -1);
}

void MapConvolution::Widen(const scene::Raster& raster, int row, Rows* rows) const {
  const int place = row % layer_.kernel;
  if (rows->held[place] == row) return;
  rows->held[place] = row;
  const int width = layer_.input.width;
  float* floats = rows->Values(*this, row) + layer_.kernel / 2;
  for (int channel = 0; channel < kChannels; ++channel, floats += row_pixels_) {
    if (raster.NonzeroBlocks(channel, row) != 0) {
      kernel_.widen(raster.Row(channel, row), width, floats);
    } else {
      std::fill(floats, floats + width, 0.0F);
    }
  }
}

void MapConvolution::Row(const scene::Raster& raster, const CellMask& pixels, int row,
                         const CellMask& cells, Rows* rows, float* sums) const {
  const int padding = layer_.kernel / 2;
  const int top = row * layer_.stride - padding;
  const int first = std::max(0, -top);
  const int last = std::min(layer_.kernel, layer_.input.height - top);
  const int width = layer_.output.width;
  const int outputs = layer_.output.channels;
  kernels::MapTaps taps{};
  taps.stride = layer_.stride;
  taps.values = static_cast<int>(places_.size());
  taps.places = places_.data();
  taps.outputs = outputs;
  for (int column = 0, count = 0; column < width; column += count) {
    count = GroupAt(column, width);
    if (!Sums(cells, row, column)) continue;
    const int left = column * layer_.stride;  // in the input, with its padding
    const int right = left + (count - 1) * layer_.stride + layer_.kernel;
    taps.rows = 0;
    for (int tap = first; tap < last; ++tap) {
      if (!pixels.HasAnyOf(top + tap, left - padding, right - padding)) continue;
      Widen(raster, top + tap, rows);
      taps.inputs[taps.rows] = rows->Values(*this, top + tap) + left;
      taps.weights[taps.rows++] = weights_.data() + ptrdiff_t{tap} * taps.values * outputs;
    }
    kernel_.sum_map(taps, bias_.data(), count, sums + ptrdiff_t{column} * outputs);
  }
}

}  // namespace maneuver::inference
