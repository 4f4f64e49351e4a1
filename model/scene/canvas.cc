#include "model/scene/canvas.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cstring>
#include <utility>

#include "model/scene/lanes.h"

namespace maneuver::scene {
namespace {

// The smallest blocks of which 64 suffice for a row.
int BlockBits(int stride) {
  int bits = std::countr_zero(static_cast<unsigned>(kLanes));
  while ((stride - 1) >> bits >= 64) ++bits;
  return bits;
}

}  // namespace

Canvas::Canvas(int height, int width, int channels)
    : height_(height),
      width_(width),
      channels_(channels),
      stride_((width + 2 * kLanes - 1) / kLanes * kLanes),
      block_bits_(BlockBits(stride_)),
      planes_(static_cast<size_t>(channels) * height * stride_),
      touched_(static_cast<size_t>(height) * channels),
      area_gain_(static_cast<size_t>(height) * (static_cast<size_t>(width) + 2)) {
  assert(height > 0 && width > 0 && channels > 0);
}

// Row by row, so that all channels of a row are written while it is at hand.
void Canvas::Finish(std::span<uint8_t> picture) {
  const size_t row_bytes = static_cast<size_t>(width_) * channels_;
  assert(picture.size() == row_bytes * height_);
  uint8_t* to = picture.data();
  uint64_t* touched = touched_.data();
  for (int row = 0; row < height_; ++row, to += row_bytes) {
    std::memset(to, 0, row_bytes);
    for (int channel = 0; channel < channels_; ++channel) {
      if (const uint64_t blocks = std::exchange(*touched++, 0); blocks != 0) {
        MoveBlocks(blocks, Row(channel, row), to + channel);
      }
    }
  }
}

void Canvas::MoveBlocks(uint64_t blocks, uint8_t* row, uint8_t* to) const {
  const int block = 1 << block_bits_;
  for (; blocks != 0; blocks &= blocks - 1) {
    const int begin = std::countr_zero(blocks) << block_bits_;
    const int end = std::min(begin + block, stride_);
    for (int column = begin; column < end; column += kLanes) {
      uint64_t lanes = 0;
      static_assert(sizeof(lanes) == kLanes);
      std::memcpy(&lanes, row + column, sizeof(lanes));
      if (lanes == 0) continue;
      uint8_t* pixel = to + static_cast<ptrdiff_t>(column) * channels_;
      if (column + kLanes <= width_) {
        for (int i = 0; i < kLanes; ++i, pixel += channels_) *pixel = row[column + i];
      } else {
        for (int i = column; i < width_; ++i, pixel += channels_) *pixel = row[i];
      }
      std::memset(row + column, 0, kLanes);
    }
  }
}

}  // namespace maneuver::scene
