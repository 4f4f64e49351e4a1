// The part of a raster's first convolution that reads the agents' channels. These are most of the
// channels and nearly all zero, so only nonzero values are multiplied.

#ifndef MANEUVER_MODEL_INFERENCE_SPARSE_CONVOLUTION_H_
#define MANEUVER_MODEL_INFERENCE_SPARSE_CONVOLUTION_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "model/artifact/backbone_layers.h"
#include "model/inference/cell_mask.h"
#include "model/inference/folded_convolution.h"
#include "model/kernels/aligned_vector.h"
#include "model/kernels/first_layer.h"
#include "model/scene/raster.h"

namespace maneuver::inference {

// Immutable; safe to share between threads.
class SparseConvolution {
 public:
  // The nonzero values of a raster. Each thread needs its own.
  struct Values {
    struct Pixel {
      int column;
      int begin, end;  // indices into `values`
    };
    int count = 0;                            // of values
    std::vector<kernels::PixelValue> values;  // pixel by pixel, then by channel; may be longer
    std::vector<Pixel> pixels;                // those with any nonzero value, row by row
    std::vector<int> rows;                    // [H + 1], index into `pixels` where a row begins

   private:
    friend class SparseConvolution;
    // A channel that may be nonzero in a row.
    struct RowChannel {
      int channel;
      scene::PixelBlocks blocks;
    };
    // A channel that is nonzero in a block of eight pixels.
    struct Eight {
      int channel;
      uint64_t pixels;  // a byte for each
    };
    std::vector<RowChannel> in_row;
    std::vector<Eight> in_eight;
  };

  // Returns whether a layer is supported. Its output channels must fill whole vectors.
  static bool Takes(const artifact::BackboneLayer& layer);

  // Prepares the kernel for the layer's channels from `first_channel` on. The layer must read the
  // raster's bytes directly.
  //   max_nonzero_share: the largest share of these channels' values that may be nonzero
  SparseConvolution(const artifact::BackboneLayer& layer, const FoldedConvolution& folded,
                    int first_channel, double max_nonzero_share);

  size_t bytes() const { return weights_.size() * sizeof(float); }

  // Finds the nonzero values of these channels and adds their pixels to `pixels`. Returns false if
  // there are too many.
  bool Find(const scene::Raster& raster, Values* values, CellMask* pixels) const;

  // Adds the products of `values` to an output row that holds the sums of the other channels,
  // without the layer's ReLU.
  //   sums: [w, C']
  void AddRow(const Values& values, int row, float* sums) const;

 private:
  // Finds the values of up to eight pixels of a row from `column` on.
  void FindEight(const scene::Raster& raster, int row, int column, Values* values) const;
  // Adds the products of one input row to an output row, using row `tap` of the kernel.
  void AddTap(const Values& values, int row, int tap, float* sums) const;

  const kernels::FirstLayerKernel& kernel_;
  const artifact::BackboneLayer layer_;
  const int first_channel_;
  const int max_nonzero_;                  // values
  kernels::AlignedVector<float> weights_;  // [k, k, C, C']
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_SPARSE_CONVOLUTION_H_
