#include "model/inference/sparse_convolution.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace maneuver::inference {
bool SparseConvolution::Takes(const artifact::BackboneLayer& layer) {
  return layer.kind == artifact::BackboneLayer::Kind::kConvolution && !layer.adds &&
         layer.output.channels % kernels::FirstLayerKernelInForce().lanes == 0;
}

SparseConvolution::SparseConvolution(const artifact::BackboneLayer& layer,
                                     const FoldedConvolution& folded, int first_channel,
                                     double max_nonzero_share)
    : kernel_(kernels::FirstLayerKernelInForce()),
      layer_(layer),
      first_channel_(first_channel),
      max_nonzero_(static_cast<int>(max_nonzero_share * layer.input.height * layer.input.width *
                                    (layer.input.channels - first_channel))) {
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

bool SparseConvolution::Find(const scene::Raster& raster, Values* values, CellMask* pixels) const {
  values->count = 0;
  values->pixels.clear();
  values->rows.assign(1, 0);
  for (int row = 0; row < layer_.input.height; ++row) {
    scene::PixelBlocks nonzero = 0;
    values->in_row.clear();
    for (int channel = first_channel_; channel < layer_.input.channels; ++channel) {
      const scene::PixelBlocks blocks = raster.NonzeroBlocks(channel, row);
      if (blocks != 0) values->in_row.push_back({channel, blocks});
      nonzero |= blocks;
    }
    for (; nonzero != 0; nonzero &= nonzero - 1) {
      const int begin = std::countr_zero(nonzero) * raster.block_pixels();
      const int end = std::min(begin + raster.block_pixels(), layer_.input.width);
      for (int column = begin; column < end; column += scene::Raster::kLanes) {
        FindEight(raster, row, column, values);
      }
    }
    for (size_t i = static_cast<size_t>(values->rows.back()); i < values->pixels.size(); ++i) {
      pixels->Add(row, values->pixels[i].column);
    }
    values->rows.push_back(static_cast<int>(values->pixels.size()));
    if (values->count > max_nonzero_) return false;
  }
  return true;
}

void SparseConvolution::FindEight(const scene::Raster& raster, int row, int column,
                                  Values* values) const {
  constexpr int kLanes = scene::Raster::kLanes;
  const int inside = std::min(kLanes, layer_.input.width - column);
  const uint64_t inside_bytes = ~uint64_t{0} >> (8 * (kLanes - inside));
  uint64_t nonzero = 0;
  values->in_eight.clear();
  const int block = raster.BlockOf(column);
  for (const auto& [channel, blocks] : values->in_row) {
    if ((blocks >> block & 1) == 0) continue;
    uint64_t pixels = 0;
    std::memcpy(&pixels, raster.Row(channel, row) + column, sizeof(pixels));
    pixels &= inside_bytes;
    if (pixels != 0) values->in_eight.push_back({channel, pixels});
    nonzero |= pixels;
  }
  const size_t room = static_cast<size_t>(values->count) + kLanes * values->in_eight.size();
  if (values->values.size() < room) values->values.resize(2 * room);
  while (nonzero != 0) {
    const int shift = std::countr_zero(nonzero) / 8 * 8;
    const int begin = values->count;
    kernels::PixelValue* value = &values->values[static_cast<size_t>(begin)];
    for (const Values::Eight& eight : values->in_eight) {
      const auto byte = static_cast<uint8_t>(eight.pixels >> shift);
      *value = {eight.channel, static_cast<float>(byte)};
      value += byte != 0 ? 1 : 0;
    }
    values->count = static_cast<int>(value - values->values.data());
    values->pixels.push_back({column + shift / 8, begin, values->count});
    nonzero &= ~(uint64_t{0xff} << shift);
  }
}

void SparseConvolution::AddTap(const Values& values, int row, int tap, float* sums) const {
  const int kernel = layer_.kernel;
  const int stride = layer_.stride;
  const int channels = layer_.output.channels;
  for (int p = values.rows[row]; p < values.rows[row + 1]; ++p) {
    const Values::Pixel& pixel = values.pixels[p];
    const int from_left = pixel.column + kernel / 2;
    for (int column_tap = from_left % stride; column_tap < kernel; column_tap += stride) {
      const int column = (from_left - column_tap) / stride;
      if (from_left < column_tap || column >= layer_.output.width) continue;
      const float* weights =
          weights_.data() + ptrdiff_t{tap * kernel + column_tap} * layer_.input.channels * channels;
      kernel_.add_values({values.values.data() + pixel.begin, values.values.data() + pixel.end},
                         weights, channels, sums + static_cast<size_t>(column) * channels);
    }
  }
}

void SparseConvolution::AddRow(const Values& values, int row, float* sums) const {
  const int top = row * layer_.stride - layer_.kernel / 2;
  const int first = std::max(0, -top);
  const int last = std::min(layer_.kernel, layer_.input.height - top);
  for (int tap = first; tap < last; ++tap) AddTap(values, top + tap, tap, sums);
}

}  // namespace maneuver::inference
