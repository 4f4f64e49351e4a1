#include "model/inference/cell_mask.h"

#include <algorithm>
#include <cstring>

namespace maneuver::inference {
namespace {

// A bit for each of eight bytes that is not 0.
uint64_t BitsOfBytes(uint64_t bytes) {
  constexpr uint64_t kLow = 0x7f7f7f7f7f7f7f7f;
  const uint64_t ones = ((((bytes & kLow) + kLow) | bytes) & ~kLow) >> 7;
  return ones * 0x0102040810204080 >> 56;
}

// Bits 0, 2, 4, .. side by side.
uint64_t EverySecond(uint64_t bits) {
  bits &= 0x5555555555555555;
  bits = (bits | bits >> 1) & 0x3333333333333333;
  bits = (bits | bits >> 2) & 0x0f0f0f0f0f0f0f0f;
  bits = (bits | bits >> 4) & 0x00ff00ff00ff00ff;
  bits = (bits | bits >> 8) & 0x0000ffff0000ffff;
  return (bits | bits >> 16) & 0x00000000ffffffff;
}

// to |= from, moved by so many cells to the right, -63 .. 63.
void OrMoved(const std::vector<uint64_t>& from, int right, std::vector<uint64_t>* to) {
  const size_t words = from.size();
  for (size_t i = 0; i < words; ++i) {
    uint64_t moved = from[i];
    if (right > 0) {
      moved <<= right;
      if (i > 0) moved |= from[i - 1] >> (64 - right);
    } else if (right < 0) {
      moved >>= -right;
      if (i + 1 < words) moved |= from[i + 1] << (64 + right);
    }
    (*to)[i] |= moved;
  }
}

}  // namespace

CellMask::CellMask(int height, int width)
    : height_(height),
      width_(width),
      words_((width + kBits - 1) / kBits),
      bits_(static_cast<size_t>(height * words_)) {}

bool CellMask::HasAny(int row) const {
  return std::any_of(Row(row), Row(row) + words_, [](uint64_t bits) { return bits != 0; });
}

void CellMask::SetAll() {
  std::ranges::fill(bits_, ~uint64_t{0});
  for (int row = 0; row < height_; ++row) ClearBeyondWidth(row);
}

void CellMask::ClearBeyondWidth(int row) {
  const int left = width_ % kBits;
  if (left != 0) Row(row)[words_ - 1] &= (uint64_t{1} << left) - 1;
}

void CellMask::SetPixels(const scene::Raster& raster, int channels) {
  constexpr int kLanes = scene::Raster::kLanes;
  std::ranges::fill(bits_, 0);
  for (int row = 0; row < height_; ++row) {
    uint64_t* const bits = Row(row);
    for (int channel = 0; channel < channels; ++channel) {
      const uint8_t* const pixels = raster.Row(channel, row);
      scene::PixelBlocks nonzero = raster.NonzeroBlocks(channel, row);
      for (; nonzero != 0; nonzero &= nonzero - 1) {
        const int begin = std::countr_zero(nonzero) * raster.block_pixels();
        const int end = std::min(begin + raster.block_pixels(), width_);
        for (int column = begin; column < end; column += kLanes) {
          uint64_t eight = 0;
          std::memcpy(&eight, pixels + column, sizeof(eight));
          bits[column / kBits] |= BitsOfBytes(eight) << (column % kBits);
        }
      }
    }
    ClearBeyondWidth(row);
  }
}

void CellMask::SetDependent(const CellMask& input, const artifact::BackboneLayer& layer) {
  const int padding = layer.kernel / 2;
  met_.resize(static_cast<size_t>((input.width_ + layer.kernel + kBits - 1) / kBits));
  seen_.resize(met_.size());
  for (int row = 0; row < height_; ++row) {
    std::ranges::fill(met_, 0);
    const int top = row * layer.stride - padding;
    const int end = std::min(top + layer.kernel, input.height_);
    for (int above = std::max(top, 0); above < end; ++above) {
      for (int i = 0; i < input.words_; ++i) met_[static_cast<size_t>(i)] |= input.Row(above)[i];
    }
    uint64_t* const bits = Row(row);
    std::fill_n(bits, words_, 0);
    if (std::ranges::all_of(met_, [](uint64_t word) { return word == 0; })) continue;
    // A kernel that begins at column c - padding meets what lies up to layer.kernel - 1 behind.
    std::ranges::fill(seen_, 0);
    for (int tap = 0; tap < layer.kernel; ++tap) OrMoved(met_, padding - tap, &seen_);
    if (layer.stride == 1) {
      std::copy_n(seen_.begin(), words_, bits);
    } else if (layer.stride == 2) {
      // What is seen behind the last column may reach into a word that the row does not have.
      const size_t words = std::min(seen_.size(), 2 * static_cast<size_t>(words_));
      for (size_t i = 0; i < words; ++i) {
        bits[i / 2] |= EverySecond(seen_[i]) << (i % 2 * kBits / 2);
      }
    } else {
      for (int column = 0; column < width_; ++column) {
        const int at = column * layer.stride;
        const uint64_t bit = seen_[static_cast<size_t>(at / kBits)] >> (at % kBits) & 1;
        bits[column / kBits] |= bit << (column % kBits);
      }
    }
    ClearBeyondWidth(row);
  }
}

}  // namespace maneuver::inference
