#include "model/learning/kernels/batch_norm_passes.h"

#include <algorithm>
#include <vector>

// Comparisons with 0 are such that what is not a number stays so: a loss is to tell.

namespace maneuver::learning {
namespace {

// So many cells are added up as floats, and then as doubles.
constexpr int64_t kCellsTogether = 128;

// add(begin, end, first, second) adds up cells as floats.
template <typename Add>
void AddUp(int64_t cells, int64_t channels, const ChannelSums& sums, const Add& add) {
  const auto count = static_cast<size_t>(channels);
  std::vector<float> first(count);
  std::vector<float> second(count);
  for (int64_t begin = 0; begin < cells; begin += kCellsTogether) {
    std::ranges::fill(first, 0.0F);
    std::ranges::fill(second, 0.0F);
    add(begin, std::min(begin + kCellsTogether, cells), first.data(), second.data());
    for (size_t c = 0; c < count; ++c) {
      sums.first[c] += static_cast<double>(first[c]);
      sums.second[c] += static_cast<double>(second[c]);
    }
  }
}

}  // namespace

void AddMoments(int64_t cells, int64_t channels, const float* x, const float* shift,
                const ChannelSums& sums) {
  AddUp(cells, channels, sums,
        [=](int64_t begin, int64_t end, float* __restrict first, float* __restrict second) {
          for (int64_t i = begin; i < end; ++i) {
            const float* const cell = x + i * channels;
            for (int64_t c = 0; c < channels; ++c) {
              const float shifted = cell[c] - shift[c];
              first[c] += shifted;
              second[c] += shifted * shifted;
            }
          }
        });
}

void NormalizeRelu(int64_t cells, int64_t channels, const float* x, const ChannelMap& map,
                   float* __restrict y) {
  for (int64_t i = 0; i < cells; ++i) {
    const int64_t cell = i * channels;
    for (int64_t c = 0; c < channels; ++c) {
      const float value = x[cell + c] * map.scale[c] + map.offset[c];
      y[cell + c] = value < 0.0F ? 0.0F : value;
    }
  }
}

void AddGradientSums(int64_t cells, int64_t channels, const float* x, const float* y_gradient,
                     const ChannelMap& map, const float* mean, const ChannelSums& sums) {
  AddUp(cells, channels, sums,
        [=](int64_t begin, int64_t end, float* __restrict first, float* __restrict second) {
          for (int64_t i = begin; i < end; ++i) {
            const int64_t cell = i * channels;
            for (int64_t c = 0; c < channels; ++c) {
              const float value = x[cell + c];
              const float seen =
                  value * map.scale[c] + map.offset[c] <= 0.0F ? 0.0F : y_gradient[cell + c];
              first[c] += seen;
              second[c] += seen * (value - mean[c]);
            }
          }
        });
}

void PassGradientBack(int64_t cells, int64_t channels, const float* x, const float* y_gradient,
                      const ChannelMap& map, const float* slope, const float* constant,
                      float* __restrict x_gradient) {
  for (int64_t i = 0; i < cells; ++i) {
    const int64_t cell = i * channels;
    for (int64_t c = 0; c < channels; ++c) {
      const float value = x[cell + c];
      const float seen = value * map.scale[c] + map.offset[c] <= 0.0F ? 0.0F : y_gradient[cell + c];
      x_gradient[cell + c] = map.scale[c] * seen + slope[c] * value + constant[c];
    }
  }
}

}  // namespace maneuver::learning
