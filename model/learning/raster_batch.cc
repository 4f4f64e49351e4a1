#include "model/learning/raster_batch.h"

#include <algorithm>
#include <utility>

#include "model/learning/parallel.h"

namespace maneuver::learning {

RasterBatch::RasterBatch(int64_t height, int64_t width, int64_t channels,
                         std::vector<kernels::NonzeroValues> rasters)
    : height_(height),
      width_(width),
      channels_(channels),
      rasters_(std::make_shared<std::vector<kernels::NonzeroValues>>(std::move(rasters))) {}

int64_t RasterBatch::nonzero() const {
  int64_t count = 0;
  for (const kernels::NonzeroValues& raster : *rasters_) count += raster.count;
  return count;
}

at::Tensor RasterBatch::Dense() const {
  const at::Tensor dense = at::empty({size(), height_, width_, channels_}, at::kByte);
  const int64_t row_bytes = width_ * channels_;
  at::parallel_for(0, size(), 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      const kernels::NonzeroValues& raster = (*this)[i];
      auto* row = dense.data_ptr<uint8_t>() + i * height_ * row_bytes;
      std::fill_n(row, height_ * row_bytes, uint8_t{0});
      for (size_t y = 0; y < static_cast<size_t>(height_); ++y, row += row_bytes) {
        for (int32_t p = raster.rows[y]; p < raster.rows[y + 1]; ++p) {
          const auto& pixel = raster.pixels[static_cast<size_t>(p)];
          for (int32_t v = pixel.begin; v < pixel.end; ++v) {
            const kernels::NonzeroValue& value = raster.values[static_cast<size_t>(v)];
            row[value.place] = static_cast<uint8_t>(value.value);
          }
        }
      }
    }
  });
  return dense;
}

}  // namespace maneuver::learning
