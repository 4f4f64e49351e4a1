#include "model/kernels/difference_layer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <utility>

#include "model/kernels/bf16.h"
#include "model/kernels/kernel_choice.h"

// What follows is compiled once for each target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "model/kernels/difference_layer.cc"
#include <hwy/foreach_target.h>
// It must come after foreach_target.h.
#include <hwy/highway.h>

// As in cell_convolution.cc: Highway 1.0.3 has no dot product of bf16 pairs.
#undef MANEUVER_DIFFERENCES_BF16
#if HWY_TARGET == HWY_AVX3 && HWY_COMPILER_GCC_ACTUAL
#define MANEUVER_DIFFERENCES_BF16 1
#else
#define MANEUVER_DIFFERENCES_BF16 0
#endif

HWY_BEFORE_NAMESPACE();
#if MANEUVER_DIFFERENCES_BF16
#pragma GCC push_options
#pragma GCC target("avx512bf16")
#endif
namespace maneuver::kernels::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Floats = hn::ScalableTag<float>;
using Vector = hn::Vec<Floats>;
constexpr int kLanes = hn::MaxLanes(Floats());

void Rectify(int width, int pairs, float* x, float* h, float* q) {
  const Floats d;
  const Vector zero = hn::Zero(d);
  const Vector half = hn::Set(d, 0.5F);
  for (int i = 0; i < width; i += kLanes) {
    const auto there = hn::FirstN(d, static_cast<size_t>(std::min(kLanes, width - i)));
    const Vector center = hn::MaskedLoad(there, d, x + i);
    const Vector rectified = hn::Max(zero, center);  // in this order NaN stays NaN
    for (int pair = 0; pair < pairs; ++pair) {
      float* const h_pair = h + ptrdiff_t{pair} * width + i;
      float* const q_pair = q + ptrdiff_t{pair} * width + i;
      const Vector difference = hn::MaskedLoad(there, d, h_pair);
      const Vector second = hn::MaskedLoad(there, d, q_pair);
      const Vector middle = hn::Add(center, second);
      const Vector plus = hn::Add(middle, difference);
      const Vector minus = hn::Sub(middle, difference);
      const auto linear = hn::Gt(hn::Min(center, hn::Min(plus, minus)), zero);
      const Vector above = hn::Max(zero, plus);
      const Vector below = hn::Max(zero, minus);
      const Vector slope = hn::Mul(half, hn::Sub(above, below));
      const Vector bend = hn::Sub(hn::Mul(half, hn::Add(above, below)), rectified);
      hn::BlendedStore(hn::IfThenElse(linear, difference, slope), there, d, h_pair);
      hn::BlendedStore(hn::IfThenElse(linear, second, bend), there, d, q_pair);
    }
    hn::BlendedStore(rectified, there, d, x + i);
  }
}

#if MANEUVER_DIFFERENCES_BF16
constexpr int kPanel = 2 * kLanes;
constexpr int kMaxRows = 12;  // 24 sums, with two weights and an input, fit the 32 registers

// Two rows of weights are interleaved when they are read: each 128-bit part of one with the same
// part of the other, its lower four outputs first. In this order the lower halves are the panel's
// first vector of outputs.
constexpr int Place(int output) {
  const int in_vector = output % kLanes;
  return in_vector / 4 * 8 + output / kLanes * 4 + in_vector % 4;
}

// A block of rows: the inputs that are not 0 in all of them, in pairs.
struct Block {
  const uint16_t* x;  // [rows, stride] bf16
  size_t stride;
  const uint32_t* nonzero;  // [2 * pairs]
  size_t pairs;
};

// Computes `kRows` rows by `kVectors` vectors of a panel, held in registers. All loops but that
// over the inputs are unrolled by name, as in dense_layer.cc.
//   weights: [inputs, kPanel];  y: [kRows, stride]
template <int kRows, int kVectors>
void ApplyTile(const Block& block, const uint16_t* weights, size_t stride, float* y) {
  const Floats d;
  Vector sums[kRows][kVectors];
#pragma GCC unroll 12
  for (int r = 0; r < kRows; ++r) {
#pragma GCC unroll 2
    for (int v = 0; v < kVectors; ++v) sums[r][v] = hn::Zero(d);
  }
  for (size_t n = 0; n < block.pairs; ++n) {
    const __m512i first = _mm512_load_si512(weights + block.nonzero[2 * n] * kPanel);
    const __m512i second = _mm512_load_si512(weights + block.nonzero[2 * n + 1] * kPanel);
    const __m512i pairs[2] = {_mm512_unpacklo_epi16(first, second),
                              _mm512_unpackhi_epi16(first, second)};
#pragma GCC unroll 12
    for (int r = 0; r < kRows; ++r) {
      int32_t inputs = 0;
      std::memcpy(&inputs, block.x + static_cast<size_t>(r) * block.stride + 2 * n, sizeof(inputs));
      const __m512i x = _mm512_set1_epi32(inputs);
#pragma GCC unroll 2
      for (int v = 0; v < kVectors; ++v) {
        sums[r][v] = Vector{_mm512_dpbf16_ps(sums[r][v].raw, (__m512bh)x, (__m512bh)pairs[v])};
      }
    }
  }
#pragma GCC unroll 12
  for (int r = 0; r < kRows; ++r) {
#pragma GCC unroll 2
    for (int v = 0; v < kVectors; ++v) {
      hn::StoreU(sums[r][v], d, y + static_cast<size_t>(r) * stride + v * kLanes);
    }
  }
}

// Finds the inputs that are not 0 in all rows, and rounds them. An odd one is followed by a 0.
Block MakeBlock(const float* x, int rows, int inputs, DifferenceScratch* scratch) {
  const Floats d;
  const hn::RebindToUnsigned<Floats> words;
  const size_t stride = (static_cast<size_t>(inputs) + 2 * kLanes) / 2 * 2;
  scratch->nonzero.resize(stride);
  scratch->narrow.resize(static_cast<size_t>(rows) * stride);
  size_t count = 0;
  for (int i = 0; i < inputs; i += kLanes) {
    const size_t left = static_cast<size_t>(std::min(kLanes, inputs - i));
    const auto there = hn::FirstN(d, left);
    Vector values[kMaxRows];
    Vector any = hn::Zero(d);
    for (int r = 0; r < rows; ++r) {
      values[r] = hn::MaskedLoad(there, d, x + ptrdiff_t{r} * inputs + i);
      any = hn::Or(any, values[r]);
    }
    const auto found = hn::Ne(hn::BitCast(words, any), hn::Zero(words));
    // Not CompressStore, which takes some processors a hundred cycles.
    hn::StoreU(hn::Compress(hn::Iota(words, static_cast<uint32_t>(i)), found), words,
               scratch->nonzero.data() + count);
    const auto kept = hn::RebindMask(d, found);
    for (int r = 0; r < rows; ++r) {
      const __m256bh rounded = _mm512_cvtneps_pbh(hn::Compress(values[r], kept).raw);
      std::memcpy(scratch->narrow.data() + static_cast<size_t>(r) * stride + count, &rounded,
                  sizeof(rounded));
    }
    count += hn::CountTrue(words, found);
  }
  scratch->nonzero[count] = 0;
  for (int r = 0; r < rows; ++r) scratch->narrow[static_cast<size_t>(r) * stride + count] = 0;
  return {scratch->narrow.data(), stride, scratch->nonzero.data(), (count + 1) / 2};
}

using Tile = void (*)(const Block&, const uint16_t*, size_t, float*);
template <int kVectors, size_t... kRows>
constexpr std::array<Tile, sizeof...(kRows)> TilesOf(std::index_sequence<kRows...>) {
  return {ApplyTile<kRows + 1, kVectors>...};
}
template <int kVectors>
constexpr auto kTiles = TilesOf<kVectors>(std::make_index_sequence<kMaxRows>{});

void Apply(const DifferenceProblem& problem, DifferenceScratch* scratch) {
  const int blocks = (problem.rows + kMaxRows - 1) / kMaxRows;
  const size_t outputs = static_cast<size_t>(problem.outputs);
  const size_t panel_size = static_cast<size_t>(problem.inputs) * kPanel;
  float tile[kMaxRows * kPanel];
  for (int b = 0; b < blocks; ++b) {
    const int row = problem.rows * b / blocks;  // 13 rows are 6 and 7, not 12 and 1
    const int rows = problem.rows * (b + 1) / blocks - row;
    const Block block =
        MakeBlock(problem.x + ptrdiff_t{row} * problem.inputs, rows, problem.inputs, scratch);
    const size_t last = static_cast<size_t>(rows - 1);
    const uint16_t* weights = problem.weights;
    float* y = problem.y + static_cast<size_t>(row) * outputs;
    for (int first = 0; first < problem.outputs; first += kPanel, weights += panel_size) {
      const int count = std::min(kPanel, problem.outputs - first);
      if (count == kPanel) {
        kTiles<2>[last](block, weights, outputs, y + first);
        continue;
      }
      // The last panel has room for more outputs than there are.
      (count <= kLanes ? kTiles<1> : kTiles<2>)[last](block, weights, kPanel, tile);
      for (int r = 0; r < rows; ++r) {
        std::copy_n(tile + r * kPanel, count, y + static_cast<size_t>(r) * outputs + first);
      }
    }
  }
}

const DifferenceKernel* Kernel() {
  static constexpr DifferenceKernel kKernel = {
      .panel = kPanel,
      .place = Place,
      .is_there = [] { return __builtin_cpu_supports("avx512bf16") != 0; },
      .apply = Apply};
  return &kKernel;
}
#else
const DifferenceKernel* Kernel() {
  static constexpr DifferenceKernel kNone = {
      .panel = 1, .place = nullptr, .is_there = [] { return false; }, .apply = nullptr};
  return &kNone;
}
#endif

}  // namespace
}  // namespace maneuver::kernels::HWY_NAMESPACE
#if MANEUVER_DIFFERENCES_BF16
#pragma GCC pop_options
#endif
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace maneuver::kernels {
namespace {

void ApplyPlain(const DifferenceProblem& problem, DifferenceScratch* /*scratch*/) {
  const float* x = problem.x;
  float* y = problem.y;
  for (int row = 0; row < problem.rows; ++row, x += problem.inputs) {
    const uint16_t* weights = problem.weights;
    for (int o = 0; o < problem.outputs; ++o, weights += problem.inputs) {
      float sum = 0;
      for (int i = 0; i < problem.inputs; ++i) {
        sum = std::fma(FromBf16(ToBf16(x[i])), FromBf16(weights[i]), sum);
      }
      *y++ = sum;
    }
  }
}

constexpr DifferenceKernel kPlain = {.panel = 1,
                                     .place = [](int /*output*/) { return 0; },
                                     .is_there = [] { return true; },
                                     .apply = ApplyPlain};

void RectifyPlain(int width, int pairs, float* x, float* h, float* q) {
  const auto rectified = [](float value) { return value < 0.0F ? 0.0F : value; };
  for (int pair = 0; pair < pairs; ++pair) {
    for (int i = 0; i < width; ++i, ++h, ++q) {
      const float plus = x[i] + *q + *h;
      const float minus = x[i] + *q - *h;
      if (x[i] > 0.0F && plus > 0.0F && minus > 0.0F) continue;
      *h = 0.5F * (rectified(plus) - rectified(minus));
      *q = 0.5F * (rectified(plus) + rectified(minus)) - rectified(x[i]);
    }
  }
  std::transform(x, x + width, x, rectified);
}

HWY_EXPORT(Kernel);
HWY_EXPORT(Rectify);

const DifferenceKernel* KernelInForce() {
  return UsesPlainKernels() ? &kPlain : HWY_DYNAMIC_DISPATCH(Kernel)();
}

}  // namespace

bool DifferenceLayer::Supported() { return KernelInForce()->is_there(); }

DifferenceLayer::DifferenceLayer(int inputs, int outputs, const float* weight)
    : kernel_(KernelInForce()), inputs_(inputs), outputs_(outputs) {
  const int panel = kernel_->panel;
  const int padded = (outputs + panel - 1) / panel * panel;
  weights_.resize(static_cast<size_t>(padded) * static_cast<size_t>(inputs));
  for (int o = 0; o < outputs; ++o) {
    for (int i = 0; i < inputs; ++i) {
      const size_t line = static_cast<size_t>(o / panel) * inputs + i;
      weights_[line * panel + kernel_->place(o % panel)] =
          ToBf16(weight[ptrdiff_t{o} * inputs + i]);
    }
  }
}

void RectifyDifferences(int width, int pairs, float* x, float* h, float* q) {
  if (UsesPlainKernels()) return RectifyPlain(width, pairs, x, h, q);
  HWY_DYNAMIC_DISPATCH(Rectify)(width, pairs, x, h, q);
}

}  // namespace maneuver::kernels
#endif  // HWY_ONCE
