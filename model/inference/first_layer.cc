#include "model/inference/first_layer.h"

namespace maneuver::inference {
namespace {

// Where a larger share of the agents' values is nonzero, a dense convolution takes less time. In
// recorded scenes 1 to 4 % are.
constexpr double kMaxNonzeroShareF32 = 0.1;
constexpr double kMaxNonzeroShareBf16 = 0.05;

}  // namespace

bool FirstLayer::Takes(const artifact::BackboneLayer& layer) {
  return MapConvolution::Takes(layer) && SparseConvolution::Takes(layer);
}

FirstLayer::FirstLayer(const artifact::BackboneLayer& layer, const FoldedConvolution& folded,
                       bool bf16)
    : kernel_(kernels::FirstLayerKernelInForce()),
      layer_(layer),
      bf16_(bf16),
      map_(layer, folded),
      agents_(layer, folded, MapConvolution::kChannels,
              bf16 ? kMaxNonzeroShareBf16 : kMaxNonzeroShareF32) {}

bool FirstLayer::Look(const scene::Raster& raster, Scratch* scratch) const {
  scratch->map_pixels_.SetPixels(raster, MapConvolution::kChannels);
  scratch->pixels_ = scratch->map_pixels_;
  return agents_.Find(raster, &scratch->agents_, &scratch->pixels_);
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
    // Groups of cells that are summed, as many neighbours at a time as there are.
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
