#include "model/kernels/nonzero_convolution.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "model/kernels/kernel_choice.h"

// What follows is compiled once for each target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "model/kernels/nonzero_convolution.cc"
#include <hwy/foreach_target.h>
// It must come after foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace maneuver::kernels::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
// Eight lanes on every target: outputs are padded to eights.
using Floats = hn::CappedTag<float, kNonzeroPadding>;
using Vector = hn::Vec<Floats>;
constexpr int64_t kLanes = hn::MaxLanes(Floats());

constexpr int kValueBits = 8;
constexpr size_t kBits = 64;  // of a word

// Outputs are taken so many vectors at a time, which stay in registers.
constexpr int64_t kMostVectors = 4;

// A packed value's intensity.
HWY_INLINE float IntensityOf(uint32_t packed) {
  return static_cast<float>(packed & ((1U << kValueBits) - 1));
}

// Calls see(packed, row) for each cell and each value that it sees, cell by cell. `row` is the row
// of the weight [kernel, kernel, channels] that meets the value. Calls begin(cell) before and
// end(cell) after the values of each cell.
template <typename Begin, typename See, typename End>
HWY_INLINE void ForEachSeen(const ConvolutionShape& shape, const uint32_t* values,
                            const uint32_t* begins, const Begin& begin, const See& see,
                            const End& end) {
  const int64_t padding = shape.kernel / 2;
  int64_t cell = 0;
  for (int64_t y = -padding; y + padding < shape.height; y += shape.stride) {
    const int64_t top = std::max<int64_t>(y, 0);
    const int64_t bottom = std::min(y + shape.kernel, shape.height);
    for (int64_t x = -padding; x + padding < shape.width; x += shape.stride, ++cell) {
      const int64_t left = std::max<int64_t>(x, 0);
      const int64_t right = std::min(x + shape.kernel, shape.width);
      begin(cell);
      for (int64_t row = top; row < bottom; ++row) {
        const uint32_t* const row_begins = begins + row * (shape.width + 1);
        const int64_t origin = ((row - y) * shape.kernel - x) * shape.channels;
        const uint32_t* const last = values + row_begins[right];
        for (const uint32_t* packed = values + row_begins[left]; packed < last; ++packed) {
          see(*packed, origin + static_cast<int64_t>(*packed >> kValueBits));
        }
      }
      end(cell);
    }
  }
}

void FindFast(const uint8_t* bytes, size_t count, uint64_t* words) {
  const hn::CappedTag<uint8_t, kBits> d;
  const size_t lanes = hn::Lanes(d);
  for (size_t begin = 0; begin < count; begin += kBits, ++words) {
    *words = 0;
    const size_t end = std::min(begin + kBits, count);
    size_t at = begin;
    for (; at + lanes <= end; at += lanes) {
      uint64_t bits = 0;
      hn::StoreMaskBits(d, hn::Ne(hn::LoadU(d, bytes + at), hn::Zero(d)),
                        reinterpret_cast<uint8_t*>(&bits));
      *words |= bits << (at - begin);
    }
    for (; at < end; ++at) *words |= uint64_t{bytes[at] != 0} << (at - begin);
  }
}

template <int kVectors>
void ConvolveOutputs(const ConvolutionShape& shape, const uint32_t* values, const uint32_t* begins,
                     const float* weight, int64_t first, float* output) {
  const Floats d;
  const int64_t row_values = NonzeroValues::VectorMultiple(shape.outputs);
  const int64_t count = std::min<int64_t>(kVectors * kLanes, shape.outputs - first);
  Vector sums[kVectors];
  ForEachSeen(
      shape, values, begins,
      [&](int64_t) HWY_ATTR {
        for (Vector& sum : sums) sum = hn::Zero(d);
      },
      [&](uint32_t packed, int64_t row) HWY_ATTR {
        const float* const weights = weight + row * row_values + first;
        const Vector value = hn::Set(d, IntensityOf(packed));
        for (int v = 0; v < kVectors; ++v) {
          sums[v] = hn::Add(sums[v], hn::Mul(value, hn::LoadU(d, weights + v * kLanes)));
        }
      },
      [&](int64_t cell) HWY_ATTR {
        float row[kVectors * kLanes];
        for (int v = 0; v < kVectors; ++v) hn::StoreU(sums[v], d, row + v * kLanes);
        std::copy_n(row, count, output + cell * shape.outputs + first);
      });
}

template <int kVectors>
void AddOutputs(const ConvolutionShape& shape, const uint32_t* values, const uint32_t* begins,
                const float* gradient, int64_t first, float* weight_gradient) {
  const Floats d;
  const int64_t row_values = NonzeroValues::VectorMultiple(shape.outputs);
  const int64_t count = std::min<int64_t>(kVectors * kLanes, shape.outputs - first);
  Vector of_cell[kVectors];
  float row_gradient[kVectors * kLanes] = {};
  ForEachSeen(
      shape, values, begins,
      [&](int64_t cell) HWY_ATTR {
        std::copy_n(gradient + cell * shape.outputs + first, count, row_gradient);
        for (int v = 0; v < kVectors; ++v) of_cell[v] = hn::LoadU(d, row_gradient + v * kLanes);
      },
      [&](uint32_t packed, int64_t row) HWY_ATTR {
        float* const sums = weight_gradient + row * row_values + first;
        const Vector value = hn::Set(d, IntensityOf(packed));
        for (int v = 0; v < kVectors; ++v) {
          const Vector sum = hn::LoadU(d, sums + v * kLanes);
          hn::StoreU(hn::Add(sum, hn::Mul(value, of_cell[v])), d, sums + v * kLanes);
        }
      },
      [](int64_t) {});
}

// Calls take<vectors>(first) for outputs that are taken together.
template <typename Take>
void ForOutputs(int64_t outputs, const Take& take) {
  for (int64_t first = 0; first < outputs; first += kMostVectors * kLanes) {
    switch (std::min(kMostVectors, (outputs - first + kLanes - 1) / kLanes)) {
      case 1:
        take.template operator()<1>(first);
        break;
      case 2:
        take.template operator()<2>(first);
        break;
      case 3:
        take.template operator()<3>(first);
        break;
      default:
        take.template operator()<4>(first);
        break;
    }
  }
}

void ConvolveFast(const ConvolutionShape& shape, const uint32_t* values, const uint32_t* begins,
                  const float* weight, float* output) {
  ForOutputs(shape.outputs, [&]<int kVectors>(int64_t first) {
    ConvolveOutputs<kVectors>(shape, values, begins, weight, first, output);
  });
}

void AddWeightGradientFast(const ConvolutionShape& shape, const uint32_t* values,
                           const uint32_t* begins, const float* gradient, float* weight_gradient) {
  ForOutputs(shape.outputs, [&]<int kVectors>(int64_t first) {
    AddOutputs<kVectors>(shape, values, begins, gradient, first, weight_gradient);
  });
}

}  // namespace
}  // namespace maneuver::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace maneuver::kernels {
namespace {

// The order of cells and values is shared with the fast kernels.
using HWY_NAMESPACE::ForEachSeen;
using HWY_NAMESPACE::IntensityOf;
using HWY_NAMESPACE::kBits;
using HWY_NAMESPACE::kValueBits;

void FindPlain(const uint8_t* bytes, size_t count, uint64_t* words) {
  std::fill_n(words, (count + kBits - 1) / kBits, 0);
  for (size_t i = 0; i < count; ++i) words[i / kBits] |= uint64_t{bytes[i] != 0} << (i % kBits);
}

void ConvolvePlain(const ConvolutionShape& shape, const uint32_t* values, const uint32_t* begins,
                   const float* weight, float* output) {
  const int64_t row_values = NonzeroValues::VectorMultiple(shape.outputs);
  float* sums = nullptr;
  ForEachSeen(
      shape, values, begins,
      [&](int64_t cell) {
        sums = output + cell * shape.outputs;
        std::fill_n(sums, shape.outputs, 0.0F);
      },
      [&](uint32_t packed, int64_t row) {
        const float* const weights = weight + row * row_values;
        for (int64_t o = 0; o < shape.outputs; ++o) sums[o] += IntensityOf(packed) * weights[o];
      },
      [](int64_t) {});
}

void AddWeightGradientPlain(const ConvolutionShape& shape, const uint32_t* values,
                            const uint32_t* begins, const float* gradient, float* weight_gradient) {
  const int64_t row_values = NonzeroValues::VectorMultiple(shape.outputs);
  const float* of_cell = nullptr;
  ForEachSeen(
      shape, values, begins, [&](int64_t cell) { of_cell = gradient + cell * shape.outputs; },
      [&](uint32_t packed, int64_t row) {
        float* const sums = weight_gradient + row * row_values;
        for (int64_t o = 0; o < shape.outputs; ++o) sums[o] += IntensityOf(packed) * of_cell[o];
      },
      [](int64_t) {});
}

HWY_EXPORT(FindFast);
HWY_EXPORT(ConvolveFast);
HWY_EXPORT(AddWeightGradientFast);

}  // namespace

void FindNonzeroBytes(const uint8_t* bytes, size_t count, uint64_t* words) {
  const auto find = UsesPlainKernels() ? FindPlain : HWY_DYNAMIC_DISPATCH(FindFast);
  find(bytes, count, words);
}

int64_t NonzeroValues::VectorMultiple(int64_t outputs) {
  return (outputs + kNonzeroPadding - 1) / kNonzeroPadding * kNonzeroPadding;
}

NonzeroValues::NonzeroValues(const ConvolutionShape& shape, const uint8_t* raster) {
  const auto row_bytes = static_cast<size_t>(shape.width * shape.channels);
  begins_.resize(static_cast<size_t>(shape.height * (shape.width + 1)));
  uint32_t* begins = begins_.data();
  std::vector<uint64_t> words((row_bytes + kBits - 1) / kBits);
  for (int64_t y = 0; y < shape.height; ++y) {
    const uint8_t* const row = raster + static_cast<size_t>(y) * row_bytes;
    FindNonzeroBytes(row, row_bytes, words.data());
    size_t next = 0;  // place at which the next pixel begins
    const auto begin_pixels = [&](size_t end) {
      for (; next < end; next += static_cast<size_t>(shape.channels)) {
        *begins++ = static_cast<uint32_t>(values_.size());
      }
    };
    for (size_t word = 0; word < words.size(); ++word) {
      for (uint64_t bits = words[word]; bits != 0; bits &= bits - 1) {
        const size_t place = word * kBits + static_cast<size_t>(std::countr_zero(bits));
        begin_pixels(place + 1);
        values_.push_back(static_cast<uint32_t>(place) << kValueBits | row[place]);
      }
    }
    begin_pixels(row_bytes + 1);
  }
}

void NonzeroValues::Convolve(const ConvolutionShape& shape, const float* weight,
                             float* output) const {
  const auto convolve = UsesPlainKernels() ? ConvolvePlain : HWY_DYNAMIC_DISPATCH(ConvolveFast);
  convolve(shape, values_.data(), begins_.data(), weight, output);
}

void NonzeroValues::AddWeightGradient(const ConvolutionShape& shape, const float* gradient,
                                      float* weight_gradient) const {
  const auto add =
      UsesPlainKernels() ? AddWeightGradientPlain : HWY_DYNAMIC_DISPATCH(AddWeightGradientFast);
  add(shape, values_.data(), begins_.data(), gradient, weight_gradient);
}

}  // namespace maneuver::kernels
#endif  // HWY_ONCE
