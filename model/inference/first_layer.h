// A raster's first convolution, with its ReLU, without the multiplications by what is black: the
// map's channels whole, the agents' where they are filled. In f32 whatever the precision of the
// other layers.

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
#include "model/scene/raster.h"

namespace maneuver::inference {

// Immutable; safe to share between threads.
class FirstLayer {
 public:
  // One for each thread.
  class Scratch {
   public:
    explicit Scratch(const FirstLayer& layer)
        : map_pixels_(layer.layer_.input.height, layer.layer_.input.width), pixels_(map_pixels_) {}
    // Of the raster that was looked at last, those that are not black in all channels.
    const CellMask& pixels() const { return pixels_; }

   private:
    friend class FirstLayer;
    CellMask map_pixels_;  // those that are not black in the map's channels
    CellMask pixels_;
    SparseConvolution::Values agents_;
    MapConvolution::Rows map_;
    std::vector<float> sums_;  // [w, C']
  };

  static bool Takes(const artifact::BackboneLayer& layer);

  // A layer that reads the raster's bytes as they are.
  //   bf16: the other layers' precision, and that of the grid
  FirstLayer(const artifact::BackboneLayer& layer, const FoldedConvolution& folded, bool bf16);

  size_t bytes() const { return map_.bytes() + agents_.bytes(); }

  // Finds what is not black. False if so much of the agents' channels is filled that convolving all
  // of them takes less time.
  bool Look(const scene::Raster& raster, Scratch* scratch) const;

  // Of a raster that was looked at.
  //   cells: of the output, those to be written; of their neighbours some may be as well. All that
  //       see anything but black, at least
  //   grid: [h, row_values] bf16 or floats, of each row the first [w, C'];  row_values: from a row
  //       to its next
  void Evaluate(const scene::Raster& raster, const CellMask& cells, Scratch* scratch, void* grid,
                ptrdiff_t row_values) const;

 private:
  const kernels::FirstLayerKernel& kernel_;
  const artifact::BackboneLayer layer_;
  const bool bf16_;
  MapConvolution map_;
  SparseConvolution agents_;
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_FIRST_LAYER_H_
