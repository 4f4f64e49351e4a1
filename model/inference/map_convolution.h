// The part of a raster's first convolution that reads the map's channels: lines fill too much of
// them to look at each value, and too little to multiply all. Where what a few neighbours read of a
// row is black, it is passed over. In f32: three channels do not fill the pairs that bf16
// multiplies.

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

  // Cells of a row are summed in groups: how many those are that begin at `column`, the first
  // column of a group, and whether any of them is asked for.
  static int GroupAt(int column, int width) { return column + kGroup <= width ? kGroup : 1; }
  static bool Sums(const CellMask& cells, int row, int column) {
    return cells.HasAny(row, column, GroupAt(column, cells.width()));
  }

  // The input rows that an output row reads, of the map's channels, as floats, with the padding on
  // both sides. One for each thread.
  class Rows {
   private:
    friend class MapConvolution;
    float* Values(const MapConvolution& of, int row) {
      return &values[of.row_pixels_ * kChannels * static_cast<size_t>(row % of.layer_.kernel)];
    }
    std::vector<float> values;  // [k, 3, W'], row r at r % k; of a black row anything
    std::vector<int> held;      // [k] which row is in each place; -1: none
  };

  // Whether there is one for a layer: its outputs have to fill vectors.
  static bool Takes(const artifact::BackboneLayer& layer);

  // Of a layer that reads the raster's bytes as they are: kChannels of its channels.
  MapConvolution(const artifact::BackboneLayer& layer, const FoldedConvolution& folded);

  size_t bytes() const { return (weights_.size() + bias_.size()) * sizeof(float); }

  // Before the first row of each raster.
  void Begin(Rows* rows) const;
  // The groups of an output row that have any of `cells`, rows from the top to the bottom; without
  // the layer's ReLU.
  //   pixels: those of its channels that are not black
  //   sums: [w, C']
  void Row(const scene::Raster& raster, const CellMask& pixels, int row, const CellMask& cells,
           Rows* rows, float* sums) const;

 private:
  static constexpr int kGroup = kernels::kMapGroup;

  // Puts an input row into its place, if it is not there.
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
