// The sums of a raster's first convolution: the map's channels in groups of pixels, the agents' one
// nonzero value at a time.
//
// Each sum is one chain of fused multiply-adds. Its order is the same for every group and
// instruction set, so a cell has the same bits whichever other cells are computed.

#ifndef MANEUVER_MODEL_KERNELS_FIRST_LAYER_H_
#define MANEUVER_MODEL_KERNELS_FIRST_LAYER_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "model/kernels/nonzero_values.h"

namespace maneuver::kernels {

inline constexpr int kMapGroup = 4;      // neighbouring pixels of a row that are summed together
inline constexpr int kMostMapRows = 16;  // rows of a kernel

// The inputs of the sums of some pixels of an output row: the kernel's rows that are not zero for
// all of these pixels.
struct MapTaps {
  const float* inputs[kMostMapRows];   // for each row, the first value that the first pixel reads
  const float* weights[kMostMapRows];  // [values, C'] of each row
  int rows;
  int values;         // number of values that a pixel reads for a kernel row
  const int* places;  // [values] offset of each from the first
  int stride;         // input pixels from a pixel to the next one
  int outputs;        // C', a multiple of FirstLayerKernel::lanes
};

// One implementation.
struct FirstLayerKernel {
  int lanes;

  // floats = bytes, `count` of them.
  void (*widen)(const uint8_t* bytes, int count, float* floats);

  // sums = bias + every product, for 1 or kMapGroup pixels.
  //   bias: [C'];  sums: [pixels, C']
  void (*sum_map)(const MapTaps& taps, const float* bias, int pixels, float* sums);

  // sums += value * weights[place - origin] for each of the values.
  //   origin: the least place of the values' pixel
  //   weights: [C, C'];  sums: [C'];  outputs: C', a multiple of lanes
  void (*add_values)(std::span<const NonzeroValue> values, int origin, const float* weights,
                     int outputs, float* sums);

  // row = sums, or max(0, sums) with `relu`; NaN stays NaN. store_bf16 rounds to the nearest.
  void (*store)(const float* sums, ptrdiff_t count, bool relu, float* row);
  void (*store_bf16)(const float* sums, ptrdiff_t count, bool relu, uint16_t* row);
};

// Returns the implementation in use.
const FirstLayerKernel& FirstLayerKernelInForce();

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_FIRST_LAYER_H_
