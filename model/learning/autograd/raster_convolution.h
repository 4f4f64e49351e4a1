// The first convolution of a backbone, from the nonzero values of rasters.

#ifndef MANEUVER_MODEL_LEARNING_AUTOGRAD_RASTER_CONVOLUTION_H_
#define MANEUVER_MODEL_LEARNING_AUTOGRAD_RASTER_CONVOLUTION_H_

#include <cstdint>

#include "model/learning/raster_batch.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Returns at::conv2d of the rasters as numbers from 0 to 1, padded by half the kernel. On the CPU
// it skips zero values, in the gradient as well, unless more than a quarter are nonzero. Rasters
// get no gradient.
//   weight: [C', C, k, k], on the device that computes
//   returns: [B, C', h, w], channels last
at::Tensor ConvolveRasters(const RasterBatch& rasters, const at::Tensor& weight, int64_t stride);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_AUTOGRAD_RASTER_CONVOLUTION_H_
