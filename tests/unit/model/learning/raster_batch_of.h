// Makes batches of rasters from bytes instead of drawing them.

#ifndef MANEUVER_TESTS_UNIT_MODEL_LEARNING_RASTER_BATCH_OF_H_
#define MANEUVER_TESTS_UNIT_MODEL_LEARNING_RASTER_BATCH_OF_H_

#include <cstdint>
#include <utility>
#include <vector>

#include "model/learning/raster_batch.h"
#include "model/scene/nonzero_search.h"
#include "tests/unit/model/scene/raster_of.h"

namespace maneuver::learning {

//   bytes: [B, H, W, C]
inline RasterBatch RasterBatchOf(const at::Tensor& bytes) {
  scene::NonzeroSearch search;
  std::vector<kernels::NonzeroValues> rasters(static_cast<size_t>(bytes.size(0)));
  for (int64_t i = 0; i < bytes.size(0); ++i) {
    const at::Tensor one = bytes[i].contiguous();
    const scene::Raster raster = scene::RasterOf(
        static_cast<int>(one.size(0)), static_cast<int>(one.size(1)), static_cast<int>(one.size(2)),
        {one.data_ptr<uint8_t>(), static_cast<size_t>(one.numel())});
    search.Find(raster, 0, one.numel(), &rasters[static_cast<size_t>(i)]);
  }
  return {bytes.size(1), bytes.size(2), bytes.size(3), std::move(rasters)};
}

}  // namespace maneuver::learning

#endif  // MANEUVER_TESTS_UNIT_MODEL_LEARNING_RASTER_BATCH_OF_H_
