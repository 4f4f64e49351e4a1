#include "model/inference/map_convolution.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "model/inference/packet.h"

namespace maneuver::inference {
namespace {

namespace simd = Eigen::internal;

constexpr int kChannels = MapConvolution::kChannels;
static_assert(std::endian::native == std::endian::little && kChannels == 3);
constexpr int kLanes = scene::Raster::kLanes;
constexpr int kTogether = 3;   // of outputs: with a group's pixels, all registers of AVX2
constexpr int kMostRows = 16;  // of a kernel

// Eight neighbouring pixels of a channel, a byte for each.
uint64_t EightPixels(const uint8_t* pixels) {
  uint64_t eight = 0;
  std::memcpy(&eight, pixels, sizeof(eight));
  return eight;
}

void ToFloats(const uint8_t* bytes, int count, float* floats) {
  for (int i = 0; i < count; ++i) floats[i] = static_cast<float>(int{bytes[i]});
}

// Writes for each of eight pixels how many to its left are not black, and returns how many there
// are with these.
//   filled: how many before them;  pixels: all channels together
int CountFilled(int filled, uint64_t pixels, int* before) {
  constexpr uint64_t kLow = 0x7f7f7f7f7f7f7f7f;
  // A 1 in each byte that is not 0.
  const uint64_t ones = ((((pixels & kLow) + kLow) | pixels) & ~kLow) >> 7;
  const uint64_t up_to = ones * 0x0101010101010101;  // of each byte the sum of all up to it
  const auto counts = std::bit_cast<std::array<uint8_t, kLanes>>(up_to - ones);
  for (int i = 0; i < kLanes; ++i) before[i] = filled + counts[static_cast<size_t>(i)];
  return filled + static_cast<int>(up_to >> 56);
}

// What the sums of some pixels are made of.
struct Taps {
  const float* inputs[kMostRows];   // of each kernel row, where the first pixel reads it
  const int* before[kMostRows];     // of each, there: how many pixels before it are not black
  const float* weights[kMostRows];  // [values, C'] of each
  int rows;
  int values;         // that a pixel reads of a kernel row
  const int* places;  // [values] where each is, from the first
  int stride;         // input pixels from a pixel to the next one
  int kernel;         // input pixels that a pixel reads of a row
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
    const int* const before = taps.before[row];
    if (before[(kCount - 1) * taps.stride + taps.kernel] == before[0]) continue;  // all is black
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

template <typename Vectors, int kGroup>
void SumRow(Taps taps, const float* bias, const CellMask& cells, int out_row, float* sums) {
  for (int column = 0; column < cells.width();) {
    const int count = MapConvolution::GroupAt(column, cells.width());
    if (cells.HasAny(out_row, column, count)) {
      (count == 1 ? SumAllOutputs<Vectors, 1> : SumAllOutputs<Vectors, kGroup>)(taps, bias, sums);
    }
    for (int row = 0; row < taps.rows; ++row) {
      taps.before[row] += count * taps.stride;
      taps.inputs[row] += count * taps.stride;
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
      row_pixels_(
          static_cast<size_t>((layer.input.width + kLanes - 1) / kLanes * kLanes + layer.kernel)),
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
  rows->before.assign((row_pixels_ + 1) * kernel, 0);
  rows->held.assign(kernel, -1);
}

void MapConvolution::Widen(const scene::Raster& raster, int row, Rows* rows) const {
  const int place = row % layer_.kernel;
  if (rows->held[place] == row) return;
  rows->held[place] = row;
  const int width = layer_.input.width;
  const int padding = layer_.kernel / 2;
  float* const values = rows->Values(*this, row) + padding;
  int* const before = rows->Before(*this, row) + padding;
  int* const behind = rows->Before(*this, row) + row_pixels_ + 1;
  scene::PixelBlocks touched = 0;
  const uint8_t* channels[kChannels];
  for (int channel = 0; channel < kChannels; ++channel) {
    touched |= raster.Touched(channel, row);
    channels[channel] = raster.Row(channel, row);
  }
  if (touched == 0) return std::fill(before, behind, 0);  // nobody will ask for the values
  for (int channel = 0; channel < kChannels; ++channel) {
    float* const floats = values + static_cast<size_t>(channel) * row_pixels_;
    if (raster.Touched(channel, row) != 0) {
      ToFloats(channels[channel], width, floats);
    } else {
      std::fill(floats, floats + width, 0.0F);
    }
  }
  int filled = 0;
  for (int column = 0; column < width; column += kLanes) {
    uint64_t any = 0;
    if ((touched >> raster.BlockOf(column) & 1) != 0) {
      // What lies behind the last pixel may count as well: more is summed then than need be.
      for (const uint8_t* channel : channels) any |= EightPixels(channel + column);
    }
    filled = CountFilled(filled, any, before + column);
  }
  std::fill(before + width, behind, filled);
}

void MapConvolution::Row(const scene::Raster& raster, int row, const CellMask& cells, Rows* rows,
                         float* sums) const {
  const int top = row * layer_.stride - layer_.kernel / 2;
  Taps taps{};
  taps.kernel = layer_.kernel;
  taps.stride = layer_.stride;
  taps.values = static_cast<int>(places_.size());
  taps.places = places_.data();
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
  (whole ? SumRow<WholePackets, kGroup> : SumRow<HalfPackets, kGroup>)(taps, bias_.data(), cells,
                                                                       row, sums);
}

}  // namespace maneuver::inference
