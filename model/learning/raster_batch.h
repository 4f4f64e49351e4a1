// The rasters of a batch of scenes.

#ifndef MANEUVER_MODEL_LEARNING_RASTER_BATCH_H_
#define MANEUVER_MODEL_LEARNING_RASTER_BATCH_H_

#include <cstdint>
#include <memory>
#include <vector>

#include "model/kernels/nonzero_values.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Immutable; copies share the values.
class RasterBatch {
 public:
  // A batch without scenes.
  RasterBatch() = default;
  //   rasters: the nonzero values of all channels of each [height, width, channels]
  RasterBatch(int64_t height, int64_t width, int64_t channels,
              std::vector<kernels::NonzeroValues> rasters);

  int64_t size() const { return static_cast<int64_t>(rasters_->size()); }
  int64_t height() const { return height_; }
  int64_t width() const { return width_; }
  int64_t channels() const { return channels_; }
  const kernels::NonzeroValues& operator[](int64_t i) const {
    return (*rasters_)[static_cast<size_t>(i)];
  }
  // Return the number of all values, and of those that are nonzero.
  int64_t values() const { return size() * height_ * width_ * channels_; }
  int64_t nonzero() const;

  // Returns all values, zeros as well: [B, H, W, C] bytes.
  at::Tensor Dense() const;

 private:
  int64_t height_ = 0;
  int64_t width_ = 0;
  int64_t channels_ = 0;
  std::shared_ptr<const std::vector<kernels::NonzeroValues>> rasters_ =
      std::make_shared<std::vector<kernels::NonzeroValues>>();
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_RASTER_BATCH_H_
