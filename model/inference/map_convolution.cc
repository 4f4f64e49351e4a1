#include "model/inference/map_convolution.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "model/inference/packet.h"

namespace maneuver::inference {
namespace {

namespace simd = Eigen::internal;

constexpr int kChannels = MapConvolution::kChannels;
static_assert(std::endian::native == std::endian::little && kChannels == 3);
constexpr uint32_t kMapBytes = 0xffffff;  // of four bytes, the first
constexpr int kPixels = 4;                // of a row that are summed at a time
constexpr int kTogether = 3;              // of outputs: with four pixels, all registers of AVX2
constexpr int kMostRows = 16;             // of a kernel

using FourWords = uint32_t __attribute__((vector_size(16)));
using FourIntegers = int32_t __attribute__((vector_size(16)));
using FourFloats = float __attribute__((vector_size(16)));

// What the sums of some pixels are made of.
struct Taps {
  const float* inputs[kMostRows];   // of each kernel row, at the first pixel's first value
  const int* before[kMostRows];     // of each, there: how many pixels before it are not black
  const float* weights[kMostRows];  // [values, C'] of each
  int rows;
  int values;   // of a kernel row
  int stride;   // input pixels from a pixel to the next one
  int kernel;   // input pixels that a pixel reads of a row
  int outputs;  // C'
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
  const int step = taps.stride * kChannels;
  for (int row = 0; row < taps.rows; ++row) {
    const int* const before = taps.before[row];
    if (before[(kCount - 1) * taps.stride + taps.kernel] == before[0]) continue;  // all is black
    const float* inputs = taps.inputs[row];
    const float* weights = taps.weights[row] + first_output;
    for (int value = 0; value < taps.values; ++value, ++inputs, weights += taps.outputs) {
      Vector weight[kPackets];
#pragma GCC unroll 8
      for (int p = 0; p < kPackets; ++p) weight[p] = simd::ploadu<Vector>(weights + p * kWidth);
#pragma GCC unroll 8
      for (int pixel = 0; pixel < kCount; ++pixel) {
        const Vector input = simd::pset1<Vector>(inputs[pixel * step]);
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
  using Summer = void (*)(const Taps&, const float*, int, float*);
  constexpr Summer kSummers[kTogether] = {
      SumPixels<Vectors, 1, kCount>, SumPixels<Vectors, 2, kCount>, SumPixels<Vectors, 3, kCount>};
  constexpr int kWidth = Vectors::kWidth;
  for (int done = 0; done < taps.outputs;) {
    const int packets = std::min((taps.outputs - done) / kWidth, kTogether);
    kSummers[packets - 1](taps, bias, done, sums);
    done += packets * kWidth;
  }
}

template <typename Vectors>
void SumRow(Taps taps, const float* bias, int width, float* sums) {
  for (int column = 0; column < width;) {
    const int count = column + kPixels <= width ? kPixels : 1;
    (count == 1 ? SumAllOutputs<Vectors, 1> : SumAllOutputs<Vectors, kPixels>)(taps, bias, sums);
    for (int row = 0; row < taps.rows; ++row) {
      taps.before[row] += count * taps.stride;
      taps.inputs[row] += count * taps.stride * kChannels;
    }
    sums += count * taps.outputs;
    column += count;
  }
}

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
  rows->before.assign((row_pixels_ + 1) * kernel, 0);
  rows->held.assign(kernel, -1);
}

void MapConvolution::Widen(const uint8_t* raster, int row, Rows* rows) const {
  const int place = row % layer_.kernel;
  if (rows->held[place] == row) return;
  rows->held[place] = row;
  const int padding = layer_.kernel / 2;
  const int inputs = layer_.input.channels;
  const uint8_t* pixel = raster + static_cast<size_t>(row) * layer_.input.width * inputs;
  float* value = rows->Values(*this, row) + padding * kChannels;
  int* const before = rows->Before(*this, row) + padding;
  int filled = 0;
  for (int column = 0; column < layer_.input.width; ++column, pixel += inputs) {
    before[column] = filled;
    // Four bytes at once are a few instructions; the fourth is no part of the map, and what it
    // becomes is overwritten, by the padding at last.
    uint32_t word = 0;
    std::memcpy(&word, pixel, sizeof(word));
    filled += (word & kMapBytes) != 0 ? 1 : 0;
    const FourWords bytes = (FourWords{word, word, word, word} >> FourWords{0, 8, 16, 24}) & 255;
    const FourFloats floats =
        __builtin_convertvector(std::bit_cast<FourIntegers>(bytes), FourFloats);
    std::memcpy(value, &floats, sizeof(floats));
    value += kChannels;
  }
  *value = 0.0F;
  std::fill(before + layer_.input.width, rows->Before(*this, row) + row_pixels_ + 1, filled);
}

void MapConvolution::Row(const uint8_t* raster, int row, Rows* rows, float* sums) const {
  const int top = row * layer_.stride - layer_.kernel / 2;
  Taps taps{};
  taps.kernel = layer_.kernel;
  taps.stride = layer_.stride;
  taps.values = layer_.kernel * kChannels;
  taps.outputs = layer_.output.channels;
  const int first = std::max(0, -top);
  const int last = std::min(layer_.kernel, layer_.input.height - top);
  for (int tap = first; tap < last; ++tap) {
    Widen(raster, top + tap, rows);
    taps.inputs[taps.rows] = rows->Values(*this, top + tap);
    taps.before[taps.rows] = rows->Before(*this, top + tap);
    taps.weights[taps.rows++] = weights_.data() + Eigen::Index{tap} * taps.values * taps.outputs;
  }
  const bool whole = taps.outputs % kPacket == 0;
  (whole ? SumRow<WholePackets> : SumRow<HalfPackets>)(taps, bias_.data(), layer_.output.width,
                                                       sums);
}

}  // namespace maneuver::inference
