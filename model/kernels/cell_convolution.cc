#include "model/kernels/cell_convolution.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "model/kernels/bf16.h"
#include "model/kernels/kernel_choice.h"

// What follows is compiled once for each target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "model/kernels/cell_convolution.cc"
#include <hwy/foreach_target.h>
// It must come after foreach_target.h.
#include <hwy/highway.h>

// Highway 1.0.3 has no dot product of bf16 pairs, nor the rounding to bf16 that comes with it. Two
// intrinsics of AVX-512 BF16 stand beside its AVX3 target. CellKernel::has_bf16 says whether the
// processor has them. GCC uses that extension nowhere else: an intrinsic has to ask for it.
#undef MANEUVER_CELLS_BF16
#if HWY_TARGET == HWY_AVX3 && HWY_COMPILER_GCC_ACTUAL
#define MANEUVER_CELLS_BF16 1
#else
#define MANEUVER_CELLS_BF16 0
#endif

HWY_BEFORE_NAMESPACE();
#if MANEUVER_CELLS_BF16
#pragma GCC push_options
#pragma GCC target("avx512bf16")
#endif
namespace maneuver::kernels::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Floats = hn::ScalableTag<float>;
using Vector = hn::Vec<Floats>;
constexpr int kLanes = hn::MaxLanes(Floats());

// Sums that a processor's registers hold, beside the weights that they need.
constexpr int kSums = kLanes == 16 ? 24 : 12;
constexpr int kMostCells = 8;
constexpr int CellsTogether(int vectors) { return std::min(kSums / vectors, kMostCells); }

// Returns how many vectors of outputs are summed at a time.
int VectorsTogether(int outputs) {
  for (const int together : {3, 4, 2}) {
    if (outputs / kLanes % together == 0) return together;
  }
  return 1;
}

int Together(int outputs) { return VectorsTogether(outputs) * kLanes; }

// What a step of a chain multiplies: one input, or two that are bf16.
struct Single {
  using Value = float;
  static constexpr int kStep = 1;
  static HWY_INLINE Vector Everywhere(const float* input) { return hn::Set(Floats(), *input); }
  static HWY_INLINE Vector MultiplyAdd(Vector inputs, const float* weights, Vector sums) {
    return hn::MulAdd(inputs, hn::LoadU(Floats(), weights), sums);
  }
};
HWY_INLINE void Store(Vector sums, float* outputs) { hn::StoreU(sums, Floats(), outputs); }

#if MANEUVER_CELLS_BF16
struct Pair {
  using Value = uint16_t;
  static constexpr int kStep = 2;
  static HWY_INLINE Vector Everywhere(const uint16_t* inputs) {
    int32_t pair = 0;
    std::memcpy(&pair, inputs, sizeof(pair));
    return Vector{_mm512_castsi512_ps(_mm512_set1_epi32(pair))};
  }
  static HWY_INLINE Vector MultiplyAdd(Vector inputs, const uint16_t* weights, Vector sums) {
    return Vector{
        _mm512_dpbf16_ps(sums.raw, (__m512bh)inputs.raw, (__m512bh)_mm512_loadu_ps(weights))};
  }
};
HWY_INLINE void Store(Vector sums, uint16_t* outputs) {
  const __m256bh rounded = _mm512_cvtneps_pbh(sums.raw);
  std::memcpy(outputs, &rounded, sizeof(rounded));
}
#endif

// A layer's figures.
struct Figures {
  int kernel;
  ptrdiff_t row_values;  // from an input row to the next one
  int steps;             // of a kernel row
  float least;           // of an output
};

// Computes `kVectors` vectors of the outputs of a few cells.
//   weights: [k, steps, kVectors];  bias: [kVectors]
template <typename Step, typename Output, int kVectors>
void SumCells(const Figures& figures, const typename Step::Value* const* inputs,
              const typename Step::Value* weights, const float* bias, Output* const* outputs) {
  constexpr int kCells = CellsTogether(kVectors);
  constexpr int kWeights = Step::kStep * kLanes;
  const Floats d;
  Vector sums[kCells][kVectors];
#pragma GCC unroll 8
  for (int v = 0; v < kVectors; ++v) {
    sums[0][v] = hn::LoadU(d, bias + v * kLanes);
#pragma GCC unroll 8
    for (int cell = 1; cell < kCells; ++cell) sums[cell][v] = sums[0][v];
  }
  for (int row = 0; row < figures.kernel; ++row) {
    const ptrdiff_t begin = row * figures.row_values;
    for (int step = 0; step < figures.steps; ++step, weights += kVectors * kWeights) {
      const ptrdiff_t at = begin + step * Step::kStep;
#pragma GCC unroll 8
      for (int cell = 0; cell < kCells; ++cell) {
        const Vector input = Step::Everywhere(inputs[cell] + at);
#pragma GCC unroll 8
        for (int v = 0; v < kVectors; ++v) {
          sums[cell][v] = Step::MultiplyAdd(input, weights + v * kWeights, sums[cell][v]);
        }
      }
    }
  }
  const Vector least = hn::Set(d, figures.least);
#pragma GCC unroll 8
  for (int cell = 0; cell < kCells; ++cell) {
#pragma GCC unroll 8
    for (int v = 0; v < kVectors; ++v) {
      // In this order NaN stays NaN.
      Store(hn::Max(least, sums[cell][v]), outputs[cell] + v * kLanes);
    }
  }
}

// Computes all outputs of all cells.
template <typename Step, typename Output, int kVectors>
void SumAll(const CellProblem& problem) {
  using Value = typename Step::Value;
  const CellShape& shape = problem.shape;
  const Figures figures = {.kernel = shape.kernel,
                           .row_values = problem.row_values,
                           .steps = shape.kernel * shape.inputs / Step::kStep,
                           .least = shape.relu ? 0.0F : -std::numeric_limits<float>::infinity()};
  constexpr int kCells = CellsTogether(kVectors);
  const ptrdiff_t group =
      ptrdiff_t{figures.kernel} * figures.steps * Step::kStep * kVectors * kLanes;
  for (size_t begin = 0; begin < problem.cells.size(); begin += kCells) {
    const Value* inputs[kCells];
    Output* outputs[kCells];
    for (size_t i = 0; i < kCells; ++i) {
      // The last one stands in for those that are missing.
      const Cell& cell = problem.cells[std::min(begin + i, problem.cells.size() - 1)];
      inputs[i] = static_cast<const Value*>(problem.input) + cell.input;
      outputs[i] = static_cast<Output*>(problem.output) + cell.output;
    }
    const auto* weights = static_cast<const Value*>(problem.weights);
    for (int done = 0; done < shape.outputs; done += kVectors * kLanes) {
      SumCells<Step, Output, kVectors>(figures, inputs, weights, problem.bias + done, outputs);
      for (Output*& cell : outputs) cell += kVectors * kLanes;
      weights += group;
    }
  }
}

template <typename Step, typename Output>
void SumByVectors(const CellProblem& problem) {
  constexpr void (*kSummers[])(const CellProblem&) = {
      SumAll<Step, Output, 1>, SumAll<Step, Output, 2>, SumAll<Step, Output, 3>,
      SumAll<Step, Output, 4>};
  kSummers[VectorsTogether(problem.shape.outputs) - 1](problem);
}

const CellKernel* Kernel() {
#if MANEUVER_CELLS_BF16
  static constexpr CellKernel kKernel = {
      .lanes = kLanes,
      .together = Together,
      .has_bf16 = [] { return __builtin_cpu_supports("avx512bf16") != 0; },
      .f32 = SumByVectors<Single, float>,
      .bf16 = SumByVectors<Pair, float>,
      .bf16_narrow = SumByVectors<Pair, uint16_t>};
#else
  static constexpr CellKernel kKernel = {.lanes = kLanes,
                                         .together = Together,
                                         .has_bf16 = [] { return false; },
                                         .f32 = SumByVectors<Single, float>,
                                         .bf16 = nullptr,
                                         .bf16_narrow = nullptr};
#endif
  return &kKernel;
}

}  // namespace
}  // namespace maneuver::kernels::HWY_NAMESPACE
#if MANEUVER_CELLS_BF16
#pragma GCC pop_options
#endif
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace maneuver::kernels {
namespace {

float Widen(float value) { return value; }
float Widen(uint16_t bits) { return FromBf16(bits); }
void Store(float value, float* output) { *output = value; }
void Store(float value, uint16_t* output) { *output = ToBf16(value); }

// weights: [k, k * C, C'], or in bf16 [k, k * C / 2, C', 2].
template <typename Value, typename Output>
void SumPlain(const CellProblem& problem) {
  const CellShape& shape = problem.shape;
  constexpr int kStep = sizeof(Value) == sizeof(float) ? 1 : 2;
  std::vector<float> sums(static_cast<size_t>(shape.outputs));
  for (const Cell& cell : problem.cells) {
    const auto* input = static_cast<const Value*>(problem.input) + cell.input;
    const auto* weights = static_cast<const Value*>(problem.weights);
    std::copy_n(problem.bias, sums.size(), sums.begin());
    for (int row = 0; row < shape.kernel; ++row, input += problem.row_values) {
      for (int i = 0; i < shape.kernel * shape.inputs; i += kStep) {
        for (int part = 0; part < kStep; ++part) {
          const float value = Widen(input[i + part]);
          const Value* weight = weights + part;
          for (float& sum : sums) {
            sum = std::fma(value, Widen(*weight), sum);
            weight += kStep;
          }
        }
        weights += ptrdiff_t{kStep} * shape.outputs;
      }
    }
    auto* output = static_cast<Output*>(problem.output) + cell.output;
    for (const float sum : sums) Store(shape.relu && sum < 0.0F ? 0.0F : sum, output++);
  }
}

constexpr int kPlainLanes = 8;  // supports what AVX2 does

constexpr CellKernel kPlain = {.lanes = kPlainLanes,
                               .together = [](int outputs) { return outputs; },
                               .has_bf16 = [] { return true; },
                               .f32 = SumPlain<float, float>,
                               .bf16 = SumPlain<uint16_t, float>,
                               .bf16_narrow = SumPlain<uint16_t, uint16_t>};

HWY_EXPORT(Kernel);

const CellKernel* KernelInForce() {
  return UsesPlainKernels() ? &kPlain : HWY_DYNAMIC_DISPATCH(Kernel)();
}

}  // namespace

bool CellConvolution::Supports(int inputs, int outputs, bool bf16) {
  const CellKernel* const kernel = KernelInForce();
  return outputs % kernel->lanes == 0 && (!bf16 || (kernel->has_bf16() && inputs % 2 == 0));
}

CellConvolution::CellConvolution(const CellShape& shape, std::span<const float> weight,
                                 std::span<const float> bias, bool bf16, bool narrow)
    : shape_(shape), bias_(bias.begin(), bias.end()) {
  const CellKernel* const kernel = KernelInForce();
  evaluate_ = !bf16 ? kernel->f32 : narrow ? kernel->bf16_narrow : kernel->bf16;
  const int step = bf16 ? 2 : 1;
  const int together = kernel->together(shape.outputs);
  const int taps = shape.kernel * shape.kernel;
  const auto weight_at = [&](int output, int input, int tap) {
    return weight[(static_cast<size_t>(output) * shape.inputs + input) * taps + tap];
  };
  wide_.reserve(weight.size());
  for (int first = 0; first < shape.outputs; first += together) {
    for (int tap = 0; tap < taps; ++tap) {
      for (int input = 0; input < shape.inputs; input += step) {
        for (int o = first; o < first + together; ++o) {
          for (int i = input; i < input + step; ++i) {
            wide_.push_back(weight_at(o, i, tap));
          }
        }
      }
    }
  }
  if (!bf16) return;
  narrow_.resize(wide_.size());
  std::ranges::transform(wide_, narrow_.begin(), ToBf16);
  wide_ = {};
}

void CellConvolution::Evaluate(const void* input, ptrdiff_t row_values, std::span<const Cell> cells,
                               void* output) const {
  evaluate_({.shape = shape_,
             .row_values = row_values,
             .input = input,
             .weights = narrow_.empty() ? static_cast<const void*>(wide_.data()) : narrow_.data(),
             .bias = bias_.data(),
             .cells = cells,
             .output = output});
}

}  // namespace maneuver::kernels
#endif  // HWY_ONCE
