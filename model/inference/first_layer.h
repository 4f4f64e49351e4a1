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
#include "model/scene/raster.h"

namespace maneuver::inference {

// Immutable; safe to share between threads.
class FirstLayer {
 public:
  // One for each thread.
  struct Scratch {
    MapConvolution::Rows map;
    SparseConvolution::Values agents;
    std::vector<float> sums;  // [w, C']
  };

  static bool Takes(const artifact::BackboneLayer& layer);

  // A layer that reads the raster's bytes as they are.
  //   bf16: the other layers' precision, and that of the grid
  FirstLayer(const artifact::BackboneLayer& layer, const FoldedConvolution& folded, bool bf16);

  size_t bytes() const { return map_.bytes() + agents_.bytes(); }

  // False, and nothing is done, if so much of the agents' channels is filled that convolving all of
  // them takes less time.
  //   cells: of the output, those to be written; of their neighbours some may be as well. All that
  //       see anything but black, at least
  //   grid: [h, row_values] bf16 or floats, of each row the first [w, C'];  row_values: from a row
  //       to its next
  bool Evaluate(const scene::Raster& raster, const CellMask& cells, Scratch* scratch, void* grid,
                ptrdiff_t row_values) const;

 private:
  const artifact::BackboneLayer layer_;
  const bool bf16_;
  MapConvolution map_;
  SparseConvolution agents_;
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_FIRST_LAYER_H_
