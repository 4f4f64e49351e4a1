#include "model/scene/nonzero_search.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstring>

namespace maneuver::scene {

bool NonzeroSearch::Find(const Raster& raster, int first_channel, int64_t most,
                         kernels::NonzeroValues* values) {
  values->count = 0;
  values->pixels.clear();
  values->rows.assign(1, 0);
  for (int row = 0; row < raster.height(); ++row) {
    PixelBlocks nonzero = 0;
    in_row_.clear();
    for (int channel = first_channel; channel < raster.channels(); ++channel) {
      const PixelBlocks blocks = raster.NonzeroBlocks(channel, row);
      if (blocks != 0) in_row_.push_back({channel, blocks});
      nonzero |= blocks;
    }
    for (; nonzero != 0; nonzero &= nonzero - 1) {
      const int begin = std::countr_zero(nonzero) * raster.block_pixels();
      const int end = std::min(begin + raster.block_pixels(), raster.width());
      for (int column = begin; column < end; column += Raster::kLanes) {
        FindGroup(raster, row, column, values);
      }
    }
    values->rows.push_back(static_cast<int32_t>(values->pixels.size()));
    if (values->count > most) return false;
  }
  return true;
}

void NonzeroSearch::FindGroup(const Raster& raster, int row, int column,
                              kernels::NonzeroValues* values) {
  constexpr int kLanes = Raster::kLanes;
  const int inside = std::min(kLanes, raster.width() - column);
  const uint64_t inside_bytes = ~uint64_t{0} >> (8 * (kLanes - inside));
  uint64_t nonzero = 0;
  in_group_.clear();
  const int block = raster.BlockOf(column);
  for (const auto& [channel, blocks] : in_row_) {
    if ((blocks >> block & 1) == 0) continue;
    uint64_t pixels = 0;
    std::memcpy(&pixels, raster.Row(channel, row) + column, sizeof(pixels));
    pixels &= inside_bytes;
    if (pixels != 0) in_group_.push_back({channel, pixels});
    nonzero |= pixels;
  }
  const size_t room = static_cast<size_t>(values->count) + kLanes * in_group_.size();
  if (values->values.size() < room) values->values.resize(2 * room);
  while (nonzero != 0) {
    const int shift = std::countr_zero(nonzero) / 8 * 8;
    const int pixel = column + shift / 8;
    const int32_t origin = pixel * raster.channels();
    const int32_t begin = values->count;
    kernels::NonzeroValue* value = &values->values[static_cast<size_t>(begin)];
    for (const ByteGroup& group : in_group_) {
      const auto byte = static_cast<uint8_t>(group.pixels >> shift);
      *value = {origin + group.channel, static_cast<float>(byte)};
      value += byte != 0 ? 1 : 0;
    }
    values->count = static_cast<int32_t>(value - values->values.data());
    values->pixels.push_back({pixel, begin, values->count});
    nonzero &= ~(uint64_t{0xff} << shift);
  }
}

}  // namespace maneuver::scene
