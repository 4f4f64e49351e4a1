// A backbone's layers from the raster on, as far as they are plain convolutions, evaluated where
// they see anything.
//
// Most of a raster is black. What a black raster gives is computed once; of another one, the cells
// of a layer whose whole receptive field is black are the same to the bit, and only the others are
// computed.

#ifndef MANEUVER_MODEL_INFERENCE_LEADING_LAYERS_H_
#define MANEUVER_MODEL_INFERENCE_LEADING_LAYERS_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "model/artifact/backbone_layers.h"
#include "model/inference/cell_mask.h"
#include "model/inference/first_layer.h"
#include "model/inference/folded_convolution.h"
#include "model/kernels/cell_convolution.h"
#include "model/scene/raster.h"

namespace maneuver::inference {

// Immutable; safe to share between threads.
class LeadingLayers {
 public:
  class Scratch;

  // How many of a backbone's layers, from the first one on, can be evaluated so.
  static size_t Count(std::span<const artifact::BackboneLayer> layers, bool bf16);

  //   layers: so many of them;  folded: of each
  //   narrow: the last one's output is bf16; floats otherwise. That of the others is by `bf16`
  LeadingLayers(std::span<const artifact::BackboneLayer> layers,
                std::span<const FoldedConvolution> folded, bool bf16, bool narrow);

  size_t bytes() const;

  // False, and nothing is done, if so much of the agents' channels is filled that convolving all of
  // the raster takes less time.
  //   grid: [h, w, C'] the last layer's output, bf16 or floats
  bool Evaluate(const scene::Raster& raster, Scratch* scratch, void* grid) const;

 private:
  // A layer's output: cells with the padding around them that the next layer reads.
  struct Grid {
    int channels = 0;
    int padding = 0;
    ptrdiff_t row_values = 0;  // from a row to its next
    size_t value_bytes = 0;
    std::vector<std::byte> black;  // what a black raster gives; the padding is 0

    // Of a cell, in values.
    ptrdiff_t Place(int row, int column) const {
      return (row + padding) * row_values + ptrdiff_t{column + padding} * channels;
    }
  };

  // Puts back what black gives into the cells of a layer that were computed last and are not in its
  // mask now.
  void Blacken(size_t layer, Scratch* scratch) const;
  // Computes the cells of all layers that their masks have.
  void EvaluateCells(const scene::Raster& raster, Scratch* scratch) const;

  const std::vector<artifact::BackboneLayer> layers_;
  const FirstLayer first_;
  std::vector<kernels::CellConvolution> others_;
  std::vector<Grid> grids_;  // of each layer
};

// One for each thread.
class LeadingLayers::Scratch {
 public:
  explicit Scratch(const LeadingLayers& layers);

 private:
  friend class LeadingLayers;
  // Of each layer but the last: its grid, as black gives it but for cells of `computed_`.
  std::vector<std::vector<std::byte>> grids_;
  std::vector<std::byte*> places_;  // where each layer's grid is; the last one's is the caller's
  std::vector<CellMask> masks_;     // of each layer: what is to be computed
  std::vector<CellMask> computed_;  // and what was last
  std::vector<kernels::Cell> cells_;
  FirstLayer::Scratch first_;
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_LEADING_LAYERS_H_
