#include "model/kernels/nonzero_convolution.h"

#include <algorithm>
#include <vector>

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

// Outputs are taken so many vectors at a time, which stay in registers.
constexpr int64_t kMostVectors = 4;

// Calls see(value, row) for each cell and each value that it sees, cell by cell. `row` is the row
// of the weight [kernel, kernel, channels] that meets the value. Calls begin(cell) before and
// end(cell) after the values of each cell.
//   begins: [height, width + 1] where in `values` those of a pixel begin; the row's end
template <typename Begin, typename See, typename End>
HWY_INLINE void ForEachSeen(const ConvolutionShape& shape, const NonzeroValue* values,
                            const int32_t* begins, const Begin& begin, const See& see,
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
        const int32_t* const row_begins = begins + row * (shape.width + 1);
        const int64_t origin = ((row - y) * shape.kernel - x) * shape.channels;
        const NonzeroValue* const last = values + row_begins[right];
        for (const NonzeroValue* each = values + row_begins[left]; each < last; ++each) {
          see(each->value, origin + each->place);
        }
      }
      end(cell);
    }
  }
}

template <int kVectors>
void ConvolveOutputs(const ConvolutionShape& shape, const NonzeroValue* values,
                     const int32_t* begins, const float* weight, int64_t first, float* output) {
  const Floats d;
  const int64_t row_values = PaddedOutputs(shape.outputs);
  const int64_t count = std::min<int64_t>(kVectors * kLanes, shape.outputs - first);
  Vector sums[kVectors];
  ForEachSeen(
      shape, values, begins,
      [&](int64_t) HWY_ATTR {
        for (Vector& sum : sums) sum = hn::Zero(d);
      },
      [&](float intensity, int64_t row) HWY_ATTR {
        const float* const weights = weight + row * row_values + first;
        const Vector value = hn::Set(d, intensity);
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
void AddOutputs(const ConvolutionShape& shape, const NonzeroValue* values, const int32_t* begins,
                const float* gradient, int64_t first, float* weight_gradient) {
  const Floats d;
  const int64_t row_values = PaddedOutputs(shape.outputs);
  const int64_t count = std::min<int64_t>(kVectors * kLanes, shape.outputs - first);
  Vector of_cell[kVectors];
  float row_gradient[kVectors * kLanes] = {};
  ForEachSeen(
      shape, values, begins,
      [&](int64_t cell) HWY_ATTR {
        std::copy_n(gradient + cell * shape.outputs + first, count, row_gradient);
        for (int v = 0; v < kVectors; ++v) of_cell[v] = hn::LoadU(d, row_gradient + v * kLanes);
      },
      [&](float intensity, int64_t row) HWY_ATTR {
        float* const sums = weight_gradient + row * row_values + first;
        const Vector value = hn::Set(d, intensity);
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

void ConvolveFast(const ConvolutionShape& shape, const NonzeroValue* values, const int32_t* begins,
                  const float* weight, float* output) {
  ForOutputs(shape.outputs, [&]<int kVectors>(int64_t first) {
    ConvolveOutputs<kVectors>(shape, values, begins, weight, first, output);
  });
}

void AddWeightGradientFast(const ConvolutionShape& shape, const NonzeroValue* values,
                           const int32_t* begins, const float* gradient, float* weight_gradient) {
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

// Returns, for ForEachSeen, where the values of each pixel begin.
std::vector<int32_t> PixelBegins(const ConvolutionShape& shape, const NonzeroValues& raster) {
  std::vector<int32_t> begins(static_cast<size_t>(shape.height * (shape.width + 1)));
  auto next = begins.begin();
  int32_t end = 0;  // of the values before
  for (int64_t row = 0; row < shape.height; ++row) {
    const auto row_begin = next;
    const auto last = row_begin + shape.width + 1;
    const auto r = static_cast<size_t>(row);
    for (int32_t p = raster.rows[r]; p < raster.rows[r + 1]; ++p) {
      const NonzeroValues::Pixel& pixel = raster.pixels[static_cast<size_t>(p)];
      const auto behind = row_begin + pixel.column + 1;
      std::fill(next, behind, end);
      next = behind;
      end = pixel.end;
    }
    std::fill(next, last, end);
    next = last;
  }
  return begins;
}

void ConvolvePlain(const ConvolutionShape& shape, const NonzeroValue* values, const int32_t* begins,
                   const float* weight, float* output) {
  const int64_t row_values = PaddedOutputs(shape.outputs);
  float* sums = nullptr;
  ForEachSeen(
      shape, values, begins,
      [&](int64_t cell) {
        sums = output + cell * shape.outputs;
        std::fill_n(sums, shape.outputs, 0.0F);
      },
      [&](float intensity, int64_t row) {
        const float* const weights = weight + row * row_values;
        for (int64_t o = 0; o < shape.outputs; ++o) sums[o] += intensity * weights[o];
      },
      [](int64_t) {});
}

void AddWeightGradientPlain(const ConvolutionShape& shape, const NonzeroValue* values,
                            const int32_t* begins, const float* gradient, float* weight_gradient) {
  const int64_t row_values = PaddedOutputs(shape.outputs);
  const float* of_cell = nullptr;
  ForEachSeen(
      shape, values, begins, [&](int64_t cell) { of_cell = gradient + cell * shape.outputs; },
      [&](float intensity, int64_t row) {
        float* const sums = weight_gradient + row * row_values;
        for (int64_t o = 0; o < shape.outputs; ++o) sums[o] += intensity * of_cell[o];
      },
      [](int64_t) {});
}

HWY_EXPORT(ConvolveFast);
HWY_EXPORT(AddWeightGradientFast);

}  // namespace

void ConvolveNonzero(const ConvolutionShape& shape, const NonzeroValues& raster,
                     const float* weight, float* output) {
  const auto convolve = UsesPlainKernels() ? ConvolvePlain : HWY_DYNAMIC_DISPATCH(ConvolveFast);
  convolve(shape, raster.values.data(), PixelBegins(shape, raster).data(), weight, output);
}

void AddNonzeroWeightGradient(const ConvolutionShape& shape, const NonzeroValues& raster,
                              const float* gradient, float* weight_gradient) {
  const auto add =
      UsesPlainKernels() ? AddWeightGradientPlain : HWY_DYNAMIC_DISPATCH(AddWeightGradientFast);
  add(shape, raster.values.data(), PixelBegins(shape, raster).data(), gradient, weight_gradient);
}

}  // namespace maneuver::kernels
#endif  // HWY_ONCE
