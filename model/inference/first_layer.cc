#include "model/inference/first_layer.h"

namespace maneuver::inference {
namespace {

// Where a larger share of the agents' values is nonzero, a dense convolution takes less time. In
// recorded scenes 1 to 4 % are.
constexpr double kMaxNonzeroShareF32 = 0.1;
constexpr double kMaxNonzeroShareBf16 = 0.05;

}  // namespace

bool FirstLayer::Supports(const artifact::BackboneLayer& layer) {
  return MapConvolution::Supports(layer) && SparseConvolution::Supports(layer);
}

FirstLayer::FirstLayer(const artifact::BackboneLayer& layer, const FoldedConvolution& folded,
                       bool bf16)
    : kernel_(kernels::FirstLayerKernelInForce()),
      layer_(layer),
      bf16_(bf16),
      max_nonzero_(static_cast<int64_t>((bf16 ? kMaxNonzeroShareBf16 : kMaxNonzeroShareF32) *
                                        layer.input.height * layer.input.width *
                                        (layer.input.channels - MapConvolution::kChannels))),
      map_(layer, folded),
      agents_(layer, folded) {}

bool FirstLayer::FindNonzeroPixels(const scene::Raster& raster, Scratch* scratch) const {
  scratch->map_pixels_.SetPixels(raster, MapConvolution::kChannels);
  scratch->pixels_ = scratch->map_pixels_;
  const kernels::NonzeroValues& agents = scratch->agents_;
  if (!scratch->search_.Find(raster, MapConvolution::kChannels, max_nonzero_, &scratch->agents_)) {
    return false;
  }
  for (int row = 0; row < raster.height(); ++row) {
    for (int p = agents.rows[row]; p < agents.rows[row + 1]; ++p) {
      scratch->pixels_.Add(row, agents.pixels[p].column);
    }
  }
  return true;
}

void FirstLayer::Evaluate(const scene::Raster& raster, const CellMask& cells, Scratch* scratch,
                          void* grid, ptrdiff_t row_values) const {
  const ptrdiff_t channels = layer_.output.channels;
  const int width = layer_.output.width;
  scratch->sums_.resize(static_cast<size_t>(width * channels));
  float* const sums = scratch->sums_.data();
  map_.Begin(&scratch->map_);
  for (int row = 0; row < layer_.output.height; ++row) {
    if (!cells.HasAny(row)) continue;
    map_.Row(raster, scratch->map_pixels_, row, cells, &scratch->map_, sums);
    agents_.AddRow(scratch->agents_, row, sums);
    // Stores runs of neighbouring groups that were summed.
    for (int column = 0, end = 0; column < width; column = end) {
      const bool summed = MapConvolution::Sums(cells, row, column);
      for (end = column; end < width && MapConvolution::Sums(cells, row, end) == summed;) {
        end += MapConvolution::GroupAt(end, width);
      }
      if (!summed) continue;
      const ptrdiff_t place = row * row_values + column * channels;
      const float* const from = sums + column * channels;
      const ptrdiff_t count = (end - column) * channels;
      if (bf16_) {
        kernel_.store_bf16(from, count, layer_.relu, static_cast<uint16_t*>(grid) + place);
      } else {
        kernel_.store(from, count, layer_.relu, static_cast<float*>(grid) + place);
      }
    }
  }
}

}  // namespace maneuver::inference
