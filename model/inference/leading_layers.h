// The first layers of a backbone, as long as they are plain convolutions, evaluated only where they
// depend on nonzero pixels.
//
// Most of a raster is zero. The output for an all-zero raster is computed once. For another raster,
// a cell whose whole receptive field is zero has the same output bit for bit, and only the other
// cells are computed.

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

  // Returns how many of a backbone's layers, from the first one on, can be evaluated this way.
  static size_t Count(std::span<const artifact::BackboneLayer> layers, bool bf16);

  // Prepares the layers.
  //   layers: as many as Count returned;  folded: one for each layer
  //   bf16: the precision of all outputs but the last
  //   narrow: whether the last layer's output is bf16 instead of float
  LeadingLayers(std::span<const artifact::BackboneLayer> layers,
                std::span<const FoldedConvolution> folded, bool bf16, bool narrow);

  size_t bytes() const;

  // Evaluates the layers. Returns false, and does nothing, if so many values of the agents'
  // channels are nonzero that a dense convolution of the raster takes less time.
  //   grid: [h, w, C'] the last layer's output, bf16 or floats
  bool Evaluate(const scene::Raster& raster, Scratch* scratch, void* grid) const;

 private:
  // A layer's output: cells with the padding around them that the next layer reads.
  struct Grid {
    int channels = 0;
    int padding = 0;
    ptrdiff_t row_values = 0;  // from a row to its next
    size_t value_bytes = 0;
    std::vector<std::byte> zero_output;  // the output for an all-zero raster; the padding is 0

    // Returns the offset of a cell, in values.
    ptrdiff_t Place(int row, int column) const {
      return (row + padding) * row_values + ptrdiff_t{column + padding} * channels;
    }
  };

  // Restores the output for an all-zero raster in the cells of a layer that were computed last time
  // and are not in its mask now.
  void RestoreZeroOutput(size_t layer, Scratch* scratch) const;
  // Computes the cells of each layer that are set in its mask.
  void EvaluateCells(const scene::Raster& raster, Scratch* scratch) const;

  const std::vector<artifact::BackboneLayer> layers_;
  const FirstLayer first_;
  std::vector<kernels::CellConvolution> others_;
  std::vector<Grid> grids_;  // of each layer
};

// Each thread needs its own.
class LeadingLayers::Scratch {
 public:
  explicit Scratch(const LeadingLayers& layers);

 private:
  friend class LeadingLayers;
  // The grid of each layer but the last. Cells outside `computed_` hold the output for an all-zero
  // raster.
  std::vector<std::vector<std::byte>> grids_;
  std::vector<std::byte*> places_;  // where each layer's grid is; the caller owns the last one
  std::vector<CellMask> masks_;     // of each layer: the cells to compute
  std::vector<CellMask> computed_;  // of each layer: the cells computed last time
  std::vector<kernels::Cell> cells_;
  FirstLayer::Scratch first_;
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_LEADING_LAYERS_H_
