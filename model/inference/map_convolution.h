// The part of a raster's first convolution that reads the map's channels. Lines fill too much of
// these channels to test every value, and too little to multiply them all. So neighbouring outputs
// form a group, and a group is skipped where all that it reads of a row is zero. Computes in f32:
// three channels do not fill the pairs that bf16 multiplies.

#ifndef MANEUVER_MODEL_INFERENCE_MAP_CONVOLUTION_H_
#define MANEUVER_MODEL_INFERENCE_MAP_CONVOLUTION_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "model/artifact/backbone_layers.h"
#include "model/inference/cell_mask.h"
#include "model/inference/folded_convolution.h"
#include "model/kernels/aligned_vector.h"
#include "model/kernels/first_layer.h"
#include "model/scene/raster.h"
#include "model/scene/rasterizer.h"

namespace maneuver::inference {

// Immutable; safe to share between threads.
class MapConvolution {
 public:
  static constexpr int kChannels = scene::kTargetChannel;  // those before the target's

  // Cells of a row are summed in groups. GroupAt returns the size of the group that begins at
  // `column`; Sums returns whether any of its cells is in `cells`.
  static int GroupAt(int column, int width) { return column + kGroup <= width ? kGroup : 1; }
  static bool Sums(const CellMask& cells, int row, int column) {
    return cells.HasAny(row, column, GroupAt(column, cells.width()));
  }

  // The input rows that one output row reads: the map's channels as floats, padded on both sides.
  // Each thread needs its own.
  class Rows {
   private:
    friend class MapConvolution;
    float* Values(const MapConvolution& of, int row) {
      return &values[of.row_pixels_ * kChannels * static_cast<size_t>(row % of.layer_.kernel)];
    }
    std::vector<float> values;  // [k, 3, W'], row r at r % k; undefined for an all-zero row
    std::vector<int> held;      // [k] which row is in each place; -1: none
  };

  // Returns whether a layer is supported: its outputs must fill vectors.
  static bool Supports(const artifact::BackboneLayer& layer);

  // Prepares the first kChannels channels of a layer that reads the raster's bytes directly.
  MapConvolution(const artifact::BackboneLayer& layer, const FoldedConvolution& folded);

  size_t bytes() const { return (weights_.size() + bias_.size()) * sizeof(float); }

  // Call before the first row of each raster.
  void Begin(Rows* rows) const;
  // Computes the groups of an output row that contain any of `cells`, without the layer's ReLU.
  // Call for the rows from top to bottom.
  //   pixels: the nonzero pixels of the map's channels
  //   sums: [w, C']
  void Row(const scene::Raster& raster, const CellMask& pixels, int row, const CellMask& cells,
           Rows* rows, float* sums) const;

 private:
  static constexpr int kGroup = kernels::kMapGroup;

  // Converts an input row to floats, unless it is there already.
  void Widen(const scene::Raster& raster, int row, Rows* rows) const;

  const kernels::FirstLayerKernel& kernel_;
  const artifact::BackboneLayer layer_;
  const size_t row_pixels_;  // W': of an input row, with its padding
  std::vector<int> places_;  // [k, 3] where a pixel reads each value of a row, from the first
  kernels::AlignedVector<float> weights_;  // [k, k, 3, C']
  kernels::AlignedVector<float> bias_;     // [C']
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_MAP_CONVOLUTION_H_
