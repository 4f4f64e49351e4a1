#include "model/inference/map_convolution.h"

#include <algorithm>
#include <cstdint>

#include "model/inference/packet.h"

namespace maneuver::inference {
namespace {

namespace simd = Eigen::internal;

constexpr int kChannels = MapConvolution::kChannels;
constexpr int kTogether = 3;   // of outputs: with a group's pixels, all registers of AVX2
constexpr int kMostRows = 16;  // of a kernel

void ToFloats(const uint8_t* bytes, int count, float* floats) {
  for (int i = 0; i < count; ++i) floats[i] = static_cast<float>(int{bytes[i]});
}

// What the sums of some pixels are made of: the kernel's rows that are not black to all of them.
struct Taps {
  const float* inputs[kMostRows];   // of each, where the first pixel reads it
  const float* weights[kMostRows];  // [values, C'] of each
  int rows;
  int values;         // that a pixel reads of a kernel row
  const int* places;  // [values] where each is, from the first
  int stride;         // input pixels from a pixel to the next one
  int outputs;        // C'
};

// The sums of `kCount` pixels, `kPackets` vectors of their outputs. Each is one chain of fused
// multiply-adds, in the same order whatever the pixel.
template <typename Vectors, int kPackets, int kCount>
void SumPixels(const Taps& taps, const float* bias, int first_output, float* sums) {
  using Vector = typename Vectors::Type;
  constexpr int kWidth = Vectors::kWidth;
  Vector totals[kCount][kPackets];
#pragma GCC unroll 8
  for (int p = 0; p < kPackets; ++p) {
    totals[0][p] = simd::ploadu<Vector>(bias + first_output + p * kWidth);
#pragma GCC unroll 8
    for (int pixel = 1; pixel < kCount; ++pixel) totals[pixel][p] = totals[0][p];
  }
  for (int row = 0; row < taps.rows; ++row) {
    const float* weights = taps.weights[row] + first_output;
    for (int value = 0; value < taps.values; ++value, weights += taps.outputs) {
      const float* const inputs = taps.inputs[row] + taps.places[value];
      Vector weight[kPackets];
#pragma GCC unroll 8
      for (int p = 0; p < kPackets; ++p) weight[p] = simd::ploadu<Vector>(weights + p * kWidth);
#pragma GCC unroll 8
      for (int pixel = 0; pixel < kCount; ++pixel) {
        const Vector input = simd::pset1<Vector>(inputs[pixel * taps.stride]);
#pragma GCC unroll 8
        for (int p = 0; p < kPackets; ++p) {
          totals[pixel][p] = simd::pmadd(input, weight[p], totals[pixel][p]);
        }
      }
    }
  }
#pragma GCC unroll 8
  for (int pixel = 0; pixel < kCount; ++pixel) {
#pragma GCC unroll 8
    for (int p = 0; p < kPackets; ++p) {
      simd::pstoreu(sums + pixel * taps.outputs + first_output + p * kWidth, totals[pixel][p]);
    }
  }
}

template <typename Vectors, int kCount>
void SumAllOutputs(const Taps& taps, const float* bias, float* sums) {
  using SomeSummer = void (*)(const Taps&, const float*, int, float*);
  constexpr SomeSummer kSomeSummers[kTogether] = {
      SumPixels<Vectors, 1, kCount>, SumPixels<Vectors, 2, kCount>, SumPixels<Vectors, 3, kCount>};
  constexpr int kWidth = Vectors::kWidth;
  for (int done = 0; done < taps.outputs;) {
    const int packets = std::min((taps.outputs - done) / kWidth, kTogether);
    kSomeSummers[packets - 1](taps, bias, done, sums);
    done += packets * kWidth;
  }
}

// For one pixel, and for a group.
using Summer = void (*)(const Taps&, const float*, float*);
template <typename Vectors, int kGroup>
constexpr Summer kSummers[2] = {SumAllOutputs<Vectors, 1>, SumAllOutputs<Vectors, kGroup>};

}  // namespace

bool MapConvolution::Takes(const artifact::BackboneLayer& layer) {
  return layer.kind == artifact::BackboneLayer::Kind::kConvolution && !layer.adds &&
         layer.kernel > 1 && layer.kernel <= kMostRows && layer.input.channels > kChannels &&
         layer.output.channels % HalfPackets::kWidth == 0;
}

MapConvolution::MapConvolution(const artifact::BackboneLayer& layer,
                               const FoldedConvolution& folded)
    : layer_(layer),
      row_pixels_(static_cast<size_t>(layer.input.width + layer.kernel)),
      weights_(Eigen::Index{layer.kernel} * layer.kernel * kChannels * layer.output.channels),
      bias_(Eigen::Map<const Eigen::ArrayXf>(folded.bias.data(), layer.output.channels)) {
  for (int tap = 0; tap < layer.kernel; ++tap) {
    for (int channel = 0; channel < kChannels; ++channel) {
      places_.push_back(channel * static_cast<int>(row_pixels_) + tap);
    }
  }
  const int taps = layer.kernel * layer.kernel;
  Eigen::Index place = 0;
  for (int tap = 0; tap < taps; ++tap) {
    for (int i = 0; i < kChannels; ++i) {
      for (int o = 0; o < layer.output.channels; ++o) {
        weights_[place++] =
            folded.weight[(static_cast<size_t>(o) * layer.input.channels + i) * taps + tap];
      }
    }
  }
}

void MapConvolution::Begin(Rows* rows) const {
  const size_t kernel = static_cast<size_t>(layer_.kernel);
  rows->values.assign(row_pixels_ * kChannels * kernel, 0.0F);  // the padding stays
  rows->held.assign(kernel, -1);
}

void MapConvolution::Widen(const scene::Raster& raster, int row, Rows* rows) const {
  const int place = row % layer_.kernel;
  if (rows->held[place] == row) return;
  rows->held[place] = row;
  const int width = layer_.input.width;
  float* floats = rows->Values(*this, row) + layer_.kernel / 2;
  for (int channel = 0; channel < kChannels; ++channel, floats += row_pixels_) {
    if (raster.Touched(channel, row) != 0) {
      ToFloats(raster.Row(channel, row), width, floats);
    } else {
      std::fill(floats, floats + width, 0.0F);
    }
  }
}

void MapConvolution::Row(const scene::Raster& raster, const CellMask& pixels, int row,
                         const CellMask& cells, Rows* rows, float* sums) const {
  const int padding = layer_.kernel / 2;
  const int top = row * layer_.stride - padding;
  const int first = std::max(0, -top);
  const int last = std::min(layer_.kernel, layer_.input.height - top);
  const int width = layer_.output.width;
  const int outputs = layer_.output.channels;
  Taps taps{};
  taps.stride = layer_.stride;
  taps.values = static_cast<int>(places_.size());
  taps.places = places_.data();
  taps.outputs = outputs;
  const Summer* const summers =
      outputs % kPacket == 0 ? kSummers<WholePackets, kGroup> : kSummers<HalfPackets, kGroup>;
  for (int column = 0, count = 0; column < width; column += count) {
    count = GroupAt(column, width);
    if (!Sums(cells, row, column)) continue;
    const int left = column * layer_.stride;  // in the input, with its padding
    const int right = left + (count - 1) * layer_.stride + layer_.kernel;
    taps.rows = 0;
    for (int tap = first; tap < last; ++tap) {
      if (!pixels.HasAnyOf(top + tap, left - padding, right - padding)) continue;
      Widen(raster, top + tap, rows);
      taps.inputs[taps.rows] = rows->Values(*this, top + tap) + left;
      taps.weights[taps.rows++] = weights_.data() + Eigen::Index{tap} * taps.values * outputs;
    }
    summers[count == 1 ? 0 : 1](taps, bias_.data(), sums + ptrdiff_t{column} * outputs);
  }
}

}  // namespace maneuver::inference
