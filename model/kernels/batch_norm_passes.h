// The passes over memory of a batch normalisation followed by a ReLU (Ioffe and Szegedy, Batch
// Normalization, 2015, algorithm 1): two forward, two back. The channels of a cell are next to each
// other. All instruction sets give the same bits. NaN stays NaN, so that the loss shows it.

#ifndef MANEUVER_MODEL_KERNELS_BATCH_NORM_PASSES_H_
#define MANEUVER_MODEL_KERNELS_BATCH_NORM_PASSES_H_

#include <cstdint>

namespace maneuver::kernels {

// This many cells are added up as floats; these sums are added as doubles.
inline constexpr int64_t kBatchNormCells = 128;

// The map y = max(0, scale x + offset) of each channel. Both are [channels].
struct ChannelMap {
  const float* scale;
  const float* offset;
};

// Two sums of each channel. Both are [channels].
struct ChannelSums {
  double* first;
  double* second;
};

// All grids are [cells, channels].

// Adds the sums of x - shift and of (x - shift)^2. A shift near the mean loses the fewest digits.
//   shift: [channels]
void AddMoments(int64_t cells, int64_t channels, const float* x, const float* shift,
                const ChannelSums& sums);

// Writes y.
void NormalizeRelu(int64_t cells, int64_t channels, const float* x, const ChannelMap& map,
                   float* y);

// Adds two sums over the cells where y > 0: of y's gradient, and of that gradient times x - mean.
//   mean: [channels]
void AddGradientSums(int64_t cells, int64_t channels, const float* x, const float* y_gradient,
                     const ChannelMap& map, const float* mean, const ChannelSums& sums);

// Writes the gradient of x: scale y_gradient (0 where y is 0) + slope x + constant. The last two
// terms come from the effect of x on its channel's moments.
//   slope, constant: [channels]
void PassGradientBack(int64_t cells, int64_t channels, const float* x, const float* y_gradient,
                      const ChannelMap& map, const float* slope, const float* constant,
                      float* x_gradient);

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_BATCH_NORM_PASSES_H_
