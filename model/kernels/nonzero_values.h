// The nonzero values of a raster: what its first convolution reads, in serving and in training.
//
// Few lines and agents are near a target: about a twelfth of a raster's values is nonzero.

#ifndef MANEUVER_MODEL_KERNELS_NONZERO_VALUES_H_
#define MANEUVER_MODEL_KERNELS_NONZERO_VALUES_H_

#include <cstdint>
#include <vector>

namespace maneuver::kernels {

struct NonzeroValue {
  int32_t place;  // in its row: column * C + channel
  float value;    // 1 .. 255
};

// The nonzero values of a raster [H, W, C]: of all channels, or of those from a given one on.
struct NonzeroValues {
  struct Pixel {
    int32_t column;
    int32_t begin, end;  // indices into values
  };

  int32_t count = 0;                 // of values
  std::vector<NonzeroValue> values;  // pixel by pixel, then by channel; may be longer than count
  std::vector<Pixel> pixels;         // those with any nonzero value, row by row, left to right
  std::vector<int32_t> rows;         // [H + 1] index into pixels where each row begins

  // Returns a copy that takes no more memory than it needs.
  NonzeroValues Trimmed() const {
    return {count, {values.begin(), values.begin() + count}, pixels, rows};
  }
};

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_NONZERO_VALUES_H_
