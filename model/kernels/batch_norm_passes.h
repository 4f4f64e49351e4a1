// The passes over memory of batch normalisation with a ReLU after it (Ioffe and Szegedy, Batch
// Normalization, 2015, algorithm 1), with cells' channels next to each other: two forward, two
// back. Every target gives the same bits. NaN stays NaN: a loss must show it.

#ifndef MANEUVER_MODEL_KERNELS_BATCH_NORM_PASSES_H_
#define MANEUVER_MODEL_KERNELS_BATCH_NORM_PASSES_H_

#include <cstdint>

namespace maneuver::kernels {

// So many cells are added up as floats, and then as doubles.
inline constexpr int64_t kBatchNormCells = 128;

// Of each channel, y = max(0, scale x + offset). Both are [channels].
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

// Adds the sums of x - shift and of (x - shift)^2; a shift near the mean loses fewest digits.
//   shift: [channels]
void AddMoments(int64_t cells, int64_t channels, const float* x, const float* shift,
                const ChannelSums& sums);

// Writes y.
void NormalizeRelu(int64_t cells, int64_t channels, const float* x, const ChannelMap& map,
                   float* y);

// Adds, where y > 0, the sums of its gradient and of that times x - mean.
//   mean: [channels]
void AddGradientSums(int64_t cells, int64_t channels, const float* x, const float* y_gradient,
                     const ChannelMap& map, const float* mean, const ChannelSums& sums);

// Writes the gradient of x: scale y_gradient (0 where y is 0) + slope x + constant. The last two
// terms are what x does to its channel's moments.
//   slope, constant: [channels]
void PassGradientBack(int64_t cells, int64_t channels, const float* x, const float* y_gradient,
                      const ChannelMap& map, const float* slope, const float* constant,
                      float* x_gradient);

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_BATCH_NORM_PASSES_H_
