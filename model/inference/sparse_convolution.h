// The part of a raster's first convolution that reads the agents' channels. These are most of the
// channels and nearly all zero, so only nonzero values are multiplied.

#ifndef MANEUVER_MODEL_INFERENCE_SPARSE_CONVOLUTION_H_
#define MANEUVER_MODEL_INFERENCE_SPARSE_CONVOLUTION_H_

#include <cstddef>

#include "model/artifact/backbone_layers.h"
#include "model/inference/folded_convolution.h"
#include "model/kernels/aligned_vector.h"
#include "model/kernels/first_layer.h"
#include "model/kernels/nonzero_values.h"

namespace maneuver::inference {

// Immutable; safe to share between threads.
class SparseConvolution {
 public:
  // Returns whether a layer is supported. Its output channels must fill whole vectors.
  static bool Supports(const artifact::BackboneLayer& layer);

  // Prepares the kernel for a layer that reads the raster's bytes directly.
  SparseConvolution(const artifact::BackboneLayer& layer, const FoldedConvolution& folded);

  size_t bytes() const { return weights_.size() * sizeof(float); }

  // Adds the products of `values` to an output row that holds the sums of the other channels,
  // without the layer's ReLU.
  //   values: of the channels that are not the map's
  //   sums: [w, C']
  void AddRow(const kernels::NonzeroValues& values, int row, float* sums) const;

 private:
  // Adds the products of one input row to an output row, using row `tap` of the kernel.
  void AddTap(const kernels::NonzeroValues& values, int row, int tap, float* sums) const;

  const kernels::FirstLayerKernel& kernel_;
  const artifact::BackboneLayer layer_;
  kernels::AlignedVector<float> weights_;  // [k, k, C, C']
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_SPARSE_CONVOLUTION_H_
