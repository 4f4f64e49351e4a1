// The passes over memory of batch normalisation with a ReLU after it (Ioffe and Szegedy, Batch
// Normalization, 2015, algorithm 1), with cells' channels next to each other: two forward, two
// back.

#ifndef MANEUVER_MODEL_LEARNING_KERNELS_BATCH_NORM_PASSES_H_
#define MANEUVER_MODEL_LEARNING_KERNELS_BATCH_NORM_PASSES_H_

#include <cstdint>

namespace maneuver::learning {

// Of each channel, y = max(0, scale x + offset), NaN if that is NaN. All are [channels].
struct ChannelMap {
  const float* scale;
  const float* offset;
};

// What is added up of each channel. Both [channels].
struct ChannelSums {
  double* first;
  double* second;
};

// All grids are [cells, channels].

// Adds the sums of x - shift and of (x - shift)^2; a shift near the mean loses fewest digits.
//   shift: [channels]
void AddMoments(int64_t cells, int64_t channels, const float* x, const float* shift,
                const ChannelSums& sums);

void NormalizeRelu(int64_t cells, int64_t channels, const float* x, const ChannelMap& map,
                   float* y);

// Adds, where y > 0, the sums of its gradient and of that times x - mean.
//   mean: [channels]
void AddGradientSums(int64_t cells, int64_t channels, const float* x, const float* y_gradient,
                     const ChannelMap& map, const float* mean, const ChannelSums& sums);

// The gradient of x: scale y_gradient (0 where y is) + slope x + constant, the last two being what
// x does to its channel's moments.
//   slope, constant: [channels]
void PassGradientBack(int64_t cells, int64_t channels, const float* x, const float* y_gradient,
                      const ChannelMap& map, const float* slope, const float* constant,
                      float* x_gradient);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_KERNELS_BATCH_NORM_PASSES_H_
