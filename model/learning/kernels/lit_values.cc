#include "model/learning/kernels/lit_values.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace maneuver::learning {
namespace {

constexpr int kLanes = 8;
using Lanes = float __attribute__((vector_size(kLanes * sizeof(float))));

constexpr int kValueBits = 8;

// Outputs are taken so many vectors at a time, which stay in registers.
constexpr int64_t kMostVectors = 4;

Lanes Load(const float* from) {
  Lanes lanes;
  std::memcpy(&lanes, from, sizeof(lanes));
  return lanes;
}

void Store(const Lanes& lanes, float* to) { std::memcpy(to, &lanes, sizeof(lanes)); }

float ValueOf(uint32_t lit) { return static_cast<float>(lit & ((1U << kValueBits) - 1)); }

// Calls see(cell, lit, row) for each cell and each lit value it sees, cell by cell; row is that of
// the weight [kernel, kernel, channels] which meets the value. begin(cell) before and end(cell)
// after the values of each.
template <typename Begin, typename See, typename End>
void ForEachSeen(const ConvolutionShape& shape, const uint32_t* values, const uint32_t* begins,
                 const Begin& begin, const See& see, const End& end) {
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
        for (const uint32_t* lit = values + row_begins[left]; lit < last; ++lit) {
          see(*lit, origin + static_cast<int64_t>(*lit >> kValueBits));
        }
      }
      end(cell);
    }
  }
}

template <int kVectors>
void ConvolveOutputs(const ConvolutionShape& shape, const uint32_t* values, const uint32_t* begins,
                     const float* weight, int64_t first, float* output) {
  const int64_t row_values = LitValues::VectorMultiple(shape.outputs);
  const int64_t count = std::min<int64_t>(kVectors * kLanes, shape.outputs - first);
  Lanes sums[kVectors];
  ForEachSeen(
      shape, values, begins,
      [&](int64_t) {
        for (Lanes& sum : sums) sum = Lanes{};
      },
      [&](uint32_t lit, int64_t row) {
        const float* const weights = weight + row * row_values + first;
        const float value = ValueOf(lit);
        for (int v = 0; v < kVectors; ++v) sums[v] += value * Load(weights + v * kLanes);
      },
      [&](int64_t cell) {
        std::memcpy(output + cell * shape.outputs + first, sums,
                    static_cast<size_t>(count) * sizeof(float));
      });
}

template <int kVectors>
void AddOutputs(const ConvolutionShape& shape, const uint32_t* values, const uint32_t* begins,
                const float* gradient, int64_t first, float* weight_gradient) {
  const int64_t row_values = LitValues::VectorMultiple(shape.outputs);
  const int64_t count = std::min<int64_t>(kVectors * kLanes, shape.outputs - first);
  Lanes of_cell[kVectors] = {};
  ForEachSeen(
      shape, values, begins,
      [&](int64_t cell) {
        std::memcpy(of_cell, gradient + cell * shape.outputs + first,
                    static_cast<size_t>(count) * sizeof(float));
      },
      [&](uint32_t lit, int64_t row) {
        float* const sums = weight_gradient + row * row_values + first;
        const float value = ValueOf(lit);
        for (int v = 0; v < kVectors; ++v) {
          Store(Load(sums + v * kLanes) + value * of_cell[v], sums + v * kLanes);
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

}  // namespace

int64_t LitValues::VectorMultiple(int64_t outputs) {
  return (outputs + kLanes - 1) / kLanes * kLanes;
}

LitValues::LitValues(const ConvolutionShape& shape, const uint8_t* raster) {
  // Black is passed over by so many words at a time.
  constexpr int kWords = 4;
  constexpr int64_t kWordBytes = sizeof(uint64_t);
  const int64_t row_bytes = shape.width * shape.channels;
  begins_.resize(static_cast<size_t>(shape.height * (shape.width + 1)));
  uint32_t* begins = begins_.data();
  std::vector<uint32_t> row_values(static_cast<size_t>(row_bytes));
  for (int64_t y = 0; y < shape.height; ++y) {
    const uint8_t* const row = raster + y * row_bytes;
    const auto before = static_cast<uint32_t>(values_.size());
    uint32_t count = 0;
    int64_t next = 0;  // place at which the next pixel begins
    const auto add = [&](int64_t place) {
      for (; next <= place; next += shape.channels) *begins++ = before + count;
      row_values[count++] = static_cast<uint32_t>(place) << kValueBits | row[place];
    };
    int64_t place = 0;
    for (; place + kWords * kWordBytes <= row_bytes; place += kWords * kWordBytes) {
      uint64_t words[kWords];
      std::memcpy(words, row + place, sizeof(words));
      if ((words[0] | words[1] | words[2] | words[3]) == 0) continue;
      for (int w = 0; w < kWords; ++w) {
        while (words[w] != 0) {
          const int byte = std::countr_zero(words[w]) / 8;
          add(place + w * kWordBytes + byte);
          words[w] &= ~(uint64_t{0xff} << (8 * byte));
        }
      }
    }
    for (; place < row_bytes; ++place) {
      if (row[place] != 0) add(place);
    }
    for (; next <= row_bytes; next += shape.channels) *begins++ = before + count;
    values_.insert(values_.end(), row_values.begin(), row_values.begin() + count);
  }
}

void LitValues::Convolve(const ConvolutionShape& shape, const float* weight, float* output) const {
  ForOutputs(shape.outputs, [&]<int kVectors>(int64_t first) {
    ConvolveOutputs<kVectors>(shape, values_.data(), begins_.data(), weight, first, output);
  });
}

void LitValues::AddWeightGradient(const ConvolutionShape& shape, const float* gradient,
                                  float* weight_gradient) const {
  ForOutputs(shape.outputs, [&]<int kVectors>(int64_t first) {
    AddOutputs<kVectors>(shape, values_.data(), begins_.data(), gradient, first, weight_gradient);
  });
}

}  // namespace maneuver::learning
