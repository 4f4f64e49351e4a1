#include "model/scene/raster.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cstring>

namespace maneuver::scene {
namespace {

constexpr int kLanes = Raster::kLanes;

// Pixels cleared at a time. May exceed what was painted: all of them have to become 0 anyway.
constexpr int kCleared = 32;

// Returns log2 of the smallest block size for which 64 blocks suffice for a row.
int BlockBits(int stride) {
  int bits = std::countr_zero(static_cast<unsigned>(kLanes));
  while ((stride - 1) >> bits >= 64) ++bits;
  return bits;
}

}  // namespace

Raster::Raster(int height, int width, int channels)
    : height_(height),
      width_(width),
      channels_(channels),
      stride_((width + 2 * kLanes - 1) / kLanes * kLanes),
      block_bits_(BlockBits(stride_)),
      planes_(static_cast<size_t>(channels) * height * stride_ + kCleared),
      nonzero_(static_cast<size_t>(height) * channels) {
  assert(height > 0 && width > 0 && channels > 0);
}

void Raster::Clear() {
  PixelBlocks* nonzero = nonzero_.data();
  for (int row = 0; row < height_; ++row) {
    for (int channel = 0; channel < channels_; ++channel, ++nonzero) {
      if (*nonzero == 0) continue;
      // Clears from the first marked block to the last: most blocks between are marked too.
      const int begin = std::countr_zero(*nonzero) << block_bits_;
      const int end = std::min((64 - std::countl_zero(*nonzero)) << block_bits_, stride_);
      uint8_t* const pixels = Row(channel, row);
      for (int at = begin; at < end; at += kCleared) std::memset(pixels + at, 0, kCleared);
      *nonzero = 0;
    }
  }
}

void Raster::Mirror() {
  for (int top = 0, bottom = height_ - 1; top < bottom; ++top, --bottom) {
    for (int channel = 0; channel < channels_; ++channel) {
      if ((NonzeroBlocks(channel, top) | NonzeroBlocks(channel, bottom)) == 0) continue;
      std::swap_ranges(Row(channel, top), Row(channel, top) + stride_, Row(channel, bottom));
    }
    PixelBlocks* const blocks = nonzero_.data();
    std::swap_ranges(blocks + ptrdiff_t{top} * channels_, blocks + ptrdiff_t{top + 1} * channels_,
                     blocks + ptrdiff_t{bottom} * channels_);
  }
}

// Works row by row, so that all channels of a row are written while it is in the cache.
void Raster::WriteInterleaved(std::span<uint8_t> bytes) const {
  assert(bytes.size() == values());
  const ptrdiff_t channels = channels_;
  const size_t row_bytes = static_cast<size_t>(width_) * channels_;
  uint8_t* to = bytes.data();
  for (int row = 0; row < height_; ++row, to += row_bytes) {
    std::memset(to, 0, row_bytes);
    for (int channel = 0; channel < channels_; ++channel) {
      const uint8_t* const from = Row(channel, row);
      for (PixelBlocks left = NonzeroBlocks(channel, row); left != 0; left &= left - 1) {
        const int begin = std::countr_zero(left) << block_bits_;
        const int end = std::min(begin + block_pixels(), width_);
        for (int first = begin; first < end; first += kLanes) {
          uint64_t eight = 0;
          static_assert(sizeof(eight) == kLanes);
          std::memcpy(&eight, from + first, sizeof(eight));
          if (eight == 0) continue;
          const int behind = std::min(first + kLanes, end);
          uint8_t* pixel = to + first * channels + channel;
          for (int column = first; column < behind; ++column, pixel += channels) {
            *pixel = from[column];
          }
        }
      }
    }
  }
}

}  // namespace maneuver::scene
