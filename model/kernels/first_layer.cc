#include "model/kernels/first_layer.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "model/kernels/bf16.h"
#include "model/kernels/kernel_choice.h"

// What follows is compiled once for each target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "model/kernels/first_layer.cc"
#include <hwy/foreach_target.h>
// It must come after foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace maneuver::kernels::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
// Channels that do not fill whole vectors fill half ones.
using Floats = hn::ScalableTag<float>;
using HalfFloats = hn::Half<Floats>;
constexpr int kLanes = hn::MaxLanes(Floats());

constexpr int kMapVectors = 3;    // of outputs: with a group's pixels, all registers of AVX2
constexpr int kValueVectors = 8;  // of outputs that are summed at a time

void Widen(const uint8_t* bytes, int count, float* floats) {
  const Floats d;
  const hn::Rebind<int32_t, Floats> words;
  const hn::Rebind<uint8_t, Floats> narrow;
  int i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    const auto widened = hn::PromoteTo(words, hn::LoadU(narrow, bytes + i));
    hn::StoreU(hn::ConvertTo(d, widened), d, floats + i);
  }
  for (; i < count; ++i) floats[i] = static_cast<float>(int{bytes[i]});
}

// Sums `kVectors` vectors of the outputs of `kPixels` pixels.
template <class D, int kVectors, int kPixels>
void SumPixels(const MapTaps& taps, const float* bias, int first_output, float* sums) {
  using Vector = hn::Vec<D>;
  const D d;
  constexpr int kWidth = hn::MaxLanes(D());
  Vector totals[kPixels][kVectors];
#pragma GCC unroll 8
  for (int v = 0; v < kVectors; ++v) {
    totals[0][v] = hn::LoadU(d, bias + first_output + v * kWidth);
#pragma GCC unroll 8
    for (int pixel = 1; pixel < kPixels; ++pixel) totals[pixel][v] = totals[0][v];
  }
  for (int row = 0; row < taps.rows; ++row) {
    const float* weights = taps.weights[row] + first_output;
    for (int value = 0; value < taps.values; ++value, weights += taps.outputs) {
      const float* const inputs = taps.inputs[row] + taps.places[value];
      Vector weight[kVectors];
#pragma GCC unroll 8
      for (int v = 0; v < kVectors; ++v) weight[v] = hn::LoadU(d, weights + v * kWidth);
#pragma GCC unroll 8
      for (int pixel = 0; pixel < kPixels; ++pixel) {
        const Vector input = hn::Set(d, inputs[pixel * taps.stride]);
#pragma GCC unroll 8
        for (int v = 0; v < kVectors; ++v) {
          totals[pixel][v] = hn::MulAdd(input, weight[v], totals[pixel][v]);
        }
      }
    }
  }
#pragma GCC unroll 8
  for (int pixel = 0; pixel < kPixels; ++pixel) {
#pragma GCC unroll 8
    for (int v = 0; v < kVectors; ++v) {
      hn::StoreU(totals[pixel][v], d, sums + pixel * taps.outputs + first_output + v * kWidth);
    }
  }
}

template <class D, int kPixels>
void SumOutputs(const MapTaps& taps, const float* bias, float* sums) {
  constexpr void (*kSummers[kMapVectors])(const MapTaps&, const float*, int, float*) = {
      SumPixels<D, 1, kPixels>, SumPixels<D, 2, kPixels>, SumPixels<D, 3, kPixels>};
  constexpr int kWidth = hn::MaxLanes(D());
  for (int done = 0; done < taps.outputs;) {
    const int vectors = std::min((taps.outputs - done) / kWidth, kMapVectors);
    kSummers[vectors - 1](taps, bias, done, sums);
    done += vectors * kWidth;
  }
}

void SumMap(const MapTaps& taps, const float* bias, int pixels, float* sums) {
  const bool whole = taps.outputs % kLanes == 0;
  if (pixels == 1) {
    (whole ? SumOutputs<Floats, 1> : SumOutputs<HalfFloats, 1>)(taps, bias, sums);
  } else {
    (whole ? SumOutputs<Floats, kMapGroup> : SumOutputs<HalfFloats, kMapGroup>)(taps, bias, sums);
  }
}

// Adds to `kVectors` vectors of sums.
template <class D, int kVectors>
void AddSome(std::span<const NonzeroValue> values, int origin, const float* weights, int outputs,
             float* sums) {
  using Vector = hn::Vec<D>;
  const D d;
  constexpr int kWidth = hn::MaxLanes(D());
  Vector totals[kVectors];
#pragma GCC unroll 8
  for (int v = 0; v < kVectors; ++v) totals[v] = hn::LoadU(d, sums + v * kWidth);
  for (const NonzeroValue& each : values) {
    const Vector value = hn::Set(d, each.value);
    const float* const weight = weights + (each.place - origin) * outputs;
#pragma GCC unroll 8
    for (int v = 0; v < kVectors; ++v) {
      totals[v] = hn::MulAdd(value, hn::LoadU(d, weight + v * kWidth), totals[v]);
    }
  }
#pragma GCC unroll 8
  for (int v = 0; v < kVectors; ++v) hn::StoreU(totals[v], d, sums + v * kWidth);
}

template <class D>
void AddOutputs(std::span<const NonzeroValue> values, int origin, const float* weights, int outputs,
                float* sums) {
  constexpr void (*kAdders[kValueVectors])(std::span<const NonzeroValue>, int, const float*, int,
                                           float*) = {AddSome<D, 1>, AddSome<D, 2>, AddSome<D, 3>,
                                                      AddSome<D, 4>, AddSome<D, 5>, AddSome<D, 6>,
                                                      AddSome<D, 7>, AddSome<D, 8>};
  constexpr int kWidth = hn::MaxLanes(D());
  for (int done = 0; done < outputs;) {
    const int vectors = std::min((outputs - done) / kWidth, kValueVectors);
    kAdders[vectors - 1](values, origin, weights + done, outputs, sums + done);
    done += vectors * kWidth;
  }
}

void AddValues(std::span<const NonzeroValue> values, int origin, const float* weights, int outputs,
               float* sums) {
  (outputs % kLanes == 0 ? AddOutputs<Floats> : AddOutputs<HalfFloats>)(values, origin, weights,
                                                                        outputs, sums);
}

float Least(bool relu) { return relu ? 0.0F : -std::numeric_limits<float>::infinity(); }

void Store(const float* sums, ptrdiff_t count, bool relu, float* row) {
  const Floats d;
  const auto least = hn::Set(d, Least(relu));
  ptrdiff_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    hn::StoreU(hn::Max(least, hn::LoadU(d, sums + i)), d, row + i);
  }
  for (; i < count; ++i) row[i] = sums[i] < Least(relu) ? Least(relu) : sums[i];
}

// Highway 1.0.3 cuts bits off where it demotes to bf16. This rounds as ToBf16 does.
void StoreBf16(const float* sums, ptrdiff_t count, bool relu, uint16_t* row) {
  const Floats d;
  const hn::RebindToUnsigned<Floats> words;
  const hn::Rebind<uint16_t, Floats> halves;
  const auto least = hn::Set(d, Least(relu));
  const auto quiet_nan = hn::Set(words, uint32_t{ToBf16(std::numeric_limits<float>::quiet_NaN())});
  ptrdiff_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    const auto values = hn::Max(least, hn::LoadU(d, sums + i));
    const auto bits = hn::BitCast(words, values);
    const auto odd = hn::And(hn::ShiftRight<16>(bits), hn::Set(words, 1u));
    const auto rounded = hn::ShiftRight<16>(hn::Add(hn::Add(bits, odd), hn::Set(words, 0x7fffu)));
    const auto is_nan = hn::RebindMask(words, hn::IsNaN(values));
    hn::StoreU(hn::TruncateTo(halves, hn::IfThenElse(is_nan, quiet_nan, rounded)), halves, row + i);
  }
  for (; i < count; ++i) row[i] = ToBf16(sums[i] < Least(relu) ? Least(relu) : sums[i]);
}

const FirstLayerKernel* Kernel() {
  static constexpr FirstLayerKernel kKernel = {.lanes = hn::MaxLanes(HalfFloats()),
                                               .widen = Widen,
                                               .sum_map = SumMap,
                                               .add_values = AddValues,
                                               .store = Store,
                                               .store_bf16 = StoreBf16};
  return &kKernel;
}

}  // namespace
}  // namespace maneuver::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace maneuver::kernels {
namespace {

void WidenPlain(const uint8_t* bytes, int count, float* floats) {
  for (int i = 0; i < count; ++i) floats[i] = static_cast<float>(int{bytes[i]});
}

void SumMapPlain(const MapTaps& taps, const float* bias, int pixels, float* sums) {
  for (int pixel = 0; pixel < pixels; ++pixel, sums += taps.outputs) {
    std::copy_n(bias, taps.outputs, sums);
    for (int row = 0; row < taps.rows; ++row) {
      for (int value = 0; value < taps.values; ++value) {
        const float input = taps.inputs[row][taps.places[value] + pixel * taps.stride];
        const float* const weights = taps.weights[row] + ptrdiff_t{value} * taps.outputs;
        for (int o = 0; o < taps.outputs; ++o) sums[o] = std::fma(input, weights[o], sums[o]);
      }
    }
  }
}

void AddValuesPlain(std::span<const NonzeroValue> values, int origin, const float* weights,
                    int outputs, float* sums) {
  for (const NonzeroValue& each : values) {
    const float* const weight = weights + ptrdiff_t{each.place - origin} * outputs;
    for (int o = 0; o < outputs; ++o) sums[o] = std::fma(each.value, weight[o], sums[o]);
  }
}

void StorePlain(const float* sums, ptrdiff_t count, bool relu, float* row) {
  for (ptrdiff_t i = 0; i < count; ++i) row[i] = relu && sums[i] < 0.0F ? 0.0F : sums[i];
}

void StoreBf16Plain(const float* sums, ptrdiff_t count, bool relu, uint16_t* row) {
  for (ptrdiff_t i = 0; i < count; ++i) row[i] = ToBf16(relu && sums[i] < 0.0F ? 0.0F : sums[i]);
}

constexpr FirstLayerKernel kPlain = {.lanes = 4,  // supports what AVX2 does
                                     .widen = WidenPlain,
                                     .sum_map = SumMapPlain,
                                     .add_values = AddValuesPlain,
                                     .store = StorePlain,
                                     .store_bf16 = StoreBf16Plain};

HWY_EXPORT(Kernel);

}  // namespace

const FirstLayerKernel& FirstLayerKernelInForce() {
  return UsesPlainKernels() ? kPlain : *HWY_DYNAMIC_DISPATCH(Kernel)();
}

}  // namespace maneuver::kernels
#endif  // HWY_ONCE
