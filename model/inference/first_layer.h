// The first convolution of a raster, with its ReLU. It skips zero pixels: the map's channels are
// summed where a group of neighbours is nonzero, the agents' channels value by value. Computes in
// f32 whatever the precision of the other layers.

#ifndef MANEUVER_MODEL_INFERENCE_FIRST_LAYER_H_
#define MANEUVER_MODEL_INFERENCE_FIRST_LAYER_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "model/artifact/backbone_layers.h"
#include "model/inference/cell_mask.h"
#include "model/inference/folded_convolution.h"
#include "model/inference/map_convolution.h"
#include "model/inference/sparse_convolution.h"
#include "model/kernels/first_layer.h"
#include "model/kernels/nonzero_values.h"
#include "model/scene/nonzero_search.h"
#include "model/scene/raster.h"

namespace maneuver::inference {

// Immutable; safe to share between threads.
class FirstLayer {
 public:
  // Each thread needs its own.
  class Scratch {
   public:
    explicit Scratch(const FirstLayer& layer)
        : map_pixels_(layer.layer_.input.height, layer.layer_.input.width), pixels_(map_pixels_) {}
    // Returns the pixels that are nonzero in any channel of the last raster given to FindNonzeroPixels.
    const CellMask& pixels() const { return pixels_; }

   private:
    friend class FirstLayer;
    CellMask map_pixels_;  // nonzero in the map's channels
    CellMask pixels_;
    scene::NonzeroSearch search_;
    kernels::NonzeroValues agents_;  // of the channels that are not the map's
    MapConvolution::Rows map_;
    std::vector<float> sums_;  // [w, C']
  };

  // Returns whether a layer is supported: MapConvolution and SparseConvolution must support it.
  static bool Supports(const artifact::BackboneLayer& layer);

  // Prepares a layer that reads the raster's bytes directly.
  //   bf16: the precision of the other layers and of the grid that Evaluate writes
  FirstLayer(const artifact::BackboneLayer& layer, const FoldedConvolution& folded, bool bf16);

  size_t bytes() const { return map_.bytes() + agents_.bytes(); }

  // Finds the nonzero pixels. Returns false if so many values of the agents' channels are nonzero
  // that a dense convolution takes less time.
  bool FindNonzeroPixels(const scene::Raster& raster, Scratch* scratch) const;

  // Evaluates the layer for the raster that was given to FindNonzeroPixels.
  //   cells: the output cells to write; must contain every cell that depends on a nonzero pixel.
  //     Neighbours of these cells may be written as well.
  //   grid: [h, row_values] bf16 or floats; the first [w, C'] of each row are the output
  //   row_values: values from a row to the next
  void Evaluate(const scene::Raster& raster, const CellMask& cells, Scratch* scratch, void* grid,
                ptrdiff_t row_values) const;

 private:
  const kernels::FirstLayerKernel& kernel_;
  const artifact::BackboneLayer layer_;
  const bool bf16_;
  const int64_t max_nonzero_;  // values of the agents' channels
  MapConvolution map_;
  SparseConvolution agents_;
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_FIRST_LAYER_H_
