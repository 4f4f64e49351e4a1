#include "model/kernels/batch_norm_passes.h"

#include <algorithm>

#include "model/kernels/kernel_choice.h"

// What follows is compiled once for each target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "model/kernels/batch_norm_passes.cc"
#include <hwy/foreach_target.h>
// It must come after foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace maneuver::kernels::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
// Eight lanes on every target: channels come in eights, and memory is the limit.
using Floats = hn::CappedTag<float, 8>;
using Single = hn::CappedTag<float, 1>;
constexpr int64_t kLanes = hn::MaxLanes(Floats());

// Calls call(d, c) for vectors of channels from c on, then for single channels.
template <class Call>
HWY_INLINE void ForChannels(int64_t channels, const Call& call) {
  int64_t c = 0;
  for (; c + kLanes <= channels; c += kLanes) call(Floats(), c);
  for (; c < channels; ++c) call(Single(), c);
}

// Adds two terms of each cell, term(d, cell, c, &first, &second), to sums of channels: as floats
// over kBatchNormCells cells, then as doubles.
template <class Term>
HWY_INLINE void AddUp(int64_t cells, int64_t channels, const ChannelSums& sums, const Term& term) {
  for (int64_t begin = 0; begin < cells; begin += kBatchNormCells) {
    const int64_t end = std::min(begin + kBatchNormCells, cells);
    ForChannels(channels, [&](auto d, int64_t c) HWY_ATTR {
      auto first = hn::Zero(d);
      auto second = hn::Zero(d);
      for (int64_t cell = begin; cell < end; ++cell) {
        term(d, cell * channels + c, c, first, second);
      }
      HWY_ALIGN float totals[2][kLanes];
      hn::Store(first, d, totals[0]);
      hn::Store(second, d, totals[1]);
      for (size_t i = 0; i < hn::Lanes(d); ++i) {
        sums.first[c + static_cast<int64_t>(i)] += static_cast<double>(totals[0][i]);
        sums.second[c + static_cast<int64_t>(i)] += static_cast<double>(totals[1][i]);
      }
    });
  }
}

void FastMoments(int64_t cells, int64_t channels, const float* x, const float* shift,
                 const ChannelSums& sums) {
  AddUp(cells, channels, sums,
        [=](auto d, int64_t at, int64_t c, auto& first, auto& second) HWY_ATTR {
          const auto shifted = hn::Sub(hn::LoadU(d, x + at), hn::LoadU(d, shift + c));
          first = hn::Add(first, shifted);
          second = hn::Add(second, hn::Mul(shifted, shifted));
        });
}

void FastNormalizeRelu(int64_t cells, int64_t channels, const float* x, const ChannelMap& map,
                       float* y) {
  for (int64_t cell = 0; cell < cells; ++cell, x += channels, y += channels) {
    ForChannels(channels, [&](auto d, int64_t c) HWY_ATTR {
      const auto value = hn::Add(hn::Mul(hn::LoadU(d, x + c), hn::LoadU(d, map.scale + c)),
                                 hn::LoadU(d, map.offset + c));
      hn::StoreU(hn::Max(hn::Zero(d), value), d, y + c);  // in this order NaN stays NaN
    });
  }
}

// Returns the gradient of y where y > 0, else 0.
template <class D>
HWY_INLINE hn::Vec<D> Passed(D d, hn::Vec<D> x, const float* y_gradient, const ChannelMap& map,
                             int64_t c) {
  const auto value = hn::Add(hn::Mul(x, hn::LoadU(d, map.scale + c)), hn::LoadU(d, map.offset + c));
  return hn::IfThenZeroElse(hn::Le(value, hn::Zero(d)), hn::LoadU(d, y_gradient));
}

void FastGradientSums(int64_t cells, int64_t channels, const float* x, const float* y_gradient,
                      const ChannelMap& map, const float* mean, const ChannelSums& sums) {
  AddUp(cells, channels, sums,
        [=](auto d, int64_t at, int64_t c, auto& first, auto& second) HWY_ATTR {
          const auto value = hn::LoadU(d, x + at);
          const auto passed = Passed(d, value, y_gradient + at, map, c);
          first = hn::Add(first, passed);
          second = hn::Add(second, hn::Mul(passed, hn::Sub(value, hn::LoadU(d, mean + c))));
        });
}

void FastGradient(int64_t cells, int64_t channels, const float* x, const float* y_gradient,
                  const ChannelMap& map, const float* slope, const float* constant,
                  float* x_gradient) {
  for (int64_t cell = 0; cell < cells; ++cell) {
    const int64_t begin = cell * channels;
    ForChannels(channels, [&](auto d, int64_t c) HWY_ATTR {
      const auto value = hn::LoadU(d, x + begin + c);
      const auto passed = Passed(d, value, y_gradient + begin + c, map, c);
      const auto through = hn::Mul(hn::LoadU(d, map.scale + c), passed);
      const auto moments = hn::Mul(hn::LoadU(d, slope + c), value);
      hn::StoreU(hn::Add(hn::Add(through, moments), hn::LoadU(d, constant + c)), d,
                 x_gradient + begin + c);
    });
  }
}

}  // namespace
}  // namespace maneuver::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace maneuver::kernels {
namespace {

// Adds up term(at, c, &first, &second) of each cell.
template <typename Term>
void AddUpPlain(int64_t cells, int64_t channels, const ChannelSums& sums, const Term& term) {
  for (int64_t begin = 0; begin < cells; begin += kBatchNormCells) {
    const int64_t end = std::min(begin + kBatchNormCells, cells);
    for (int64_t c = 0; c < channels; ++c) {
      float first = 0.0F;
      float second = 0.0F;
      for (int64_t cell = begin; cell < end; ++cell) term(cell * channels + c, c, first, second);
      sums.first[c] += static_cast<double>(first);
      sums.second[c] += static_cast<double>(second);
    }
  }
}

void PlainMoments(int64_t cells, int64_t channels, const float* x, const float* shift,
                  const ChannelSums& sums) {
  AddUpPlain(cells, channels, sums, [=](int64_t at, int64_t c, float& first, float& second) {
    const float shifted = x[at] - shift[c];
    first += shifted;
    second += shifted * shifted;
  });
}

void PlainNormalizeRelu(int64_t cells, int64_t channels, const float* x, const ChannelMap& map,
                        float* y) {
  for (int64_t cell = 0; cell < cells; ++cell, x += channels, y += channels) {
    for (int64_t c = 0; c < channels; ++c) {
      const float value = x[c] * map.scale[c] + map.offset[c];
      y[c] = value < 0.0F ? 0.0F : value;
    }
  }
}

void PlainGradientSums(int64_t cells, int64_t channels, const float* x, const float* y_gradient,
                       const ChannelMap& map, const float* mean, const ChannelSums& sums) {
  AddUpPlain(cells, channels, sums, [=](int64_t at, int64_t c, float& first, float& second) {
    const float passed = x[at] * map.scale[c] + map.offset[c] <= 0.0F ? 0.0F : y_gradient[at];
    first += passed;
    second += passed * (x[at] - mean[c]);
  });
}

void PlainGradient(int64_t cells, int64_t channels, const float* x, const float* y_gradient,
                   const ChannelMap& map, const float* slope, const float* constant,
                   float* x_gradient) {
  for (int64_t cell = 0; cell < cells; ++cell) {
    for (int64_t c = 0; c < channels; ++c) {
      const int64_t at = cell * channels + c;
      const float passed = x[at] * map.scale[c] + map.offset[c] <= 0.0F ? 0.0F : y_gradient[at];
      x_gradient[at] = map.scale[c] * passed + slope[c] * x[at] + constant[c];
    }
  }
}

HWY_EXPORT(FastMoments);
HWY_EXPORT(FastNormalizeRelu);
HWY_EXPORT(FastGradientSums);
HWY_EXPORT(FastGradient);

}  // namespace

void AddMoments(int64_t cells, int64_t channels, const float* x, const float* shift,
                const ChannelSums& sums) {
  const auto add = UsesPlainKernels() ? PlainMoments : HWY_DYNAMIC_DISPATCH(FastMoments);
  add(cells, channels, x, shift, sums);
}

void NormalizeRelu(int64_t cells, int64_t channels, const float* x, const ChannelMap& map,
                   float* y) {
  const auto normalize =
      UsesPlainKernels() ? PlainNormalizeRelu : HWY_DYNAMIC_DISPATCH(FastNormalizeRelu);
  normalize(cells, channels, x, map, y);
}

void AddGradientSums(int64_t cells, int64_t channels, const float* x, const float* y_gradient,
                     const ChannelMap& map, const float* mean, const ChannelSums& sums) {
  const auto add = UsesPlainKernels() ? PlainGradientSums : HWY_DYNAMIC_DISPATCH(FastGradientSums);
  add(cells, channels, x, y_gradient, map, mean, sums);
}

void PassGradientBack(int64_t cells, int64_t channels, const float* x, const float* y_gradient,
                      const ChannelMap& map, const float* slope, const float* constant,
                      float* x_gradient) {
  const auto pass = UsesPlainKernels() ? PlainGradient : HWY_DYNAMIC_DISPATCH(FastGradient);
  pass(cells, channels, x, y_gradient, map, slope, constant, x_gradient);
}

}  // namespace maneuver::kernels
#endif  // HWY_ONCE
