// Makes rasters from bytes instead of drawing them.

#ifndef MANEUVER_TESTS_UNIT_MODEL_SCENE_RASTER_OF_H_
#define MANEUVER_TESTS_UNIT_MODEL_SCENE_RASTER_OF_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "model/scene/rasterizer.h"

namespace maneuver::scene {

//   bytes: [H, W, C]
inline Raster RasterOf(int height, int width, int channels, std::span<const uint8_t> bytes) {
  Raster raster(height, width, channels);
  size_t i = 0;
  for (int row = 0; row < height; ++row) {
    for (int column = 0; column < width; ++column) {
      for (int channel = 0; channel < channels; ++channel, ++i) {
        if (bytes[i] == 0) continue;
        raster.MarkNonzero(channel, row, raster.BlocksOf(column, column));
        raster.Row(channel, row)[column] = bytes[i];
      }
    }
  }
  return raster;
}

inline Raster RasterOf(const v1::RasterSpec& spec, std::span<const uint8_t> bytes) {
  return RasterOf(spec.height(), spec.width(), RasterChannels(spec), bytes);
}

}  // namespace maneuver::scene

#endif  // MANEUVER_TESTS_UNIT_MODEL_SCENE_RASTER_OF_H_
