#include "model/inference/sparse_convolution.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "model/inference/packet.h"

namespace maneuver::inference {
namespace {

namespace simd = Eigen::internal;
using Values = SparseConvolution::Values;
constexpr int kMostPackets = 8;  // that are summed at a time

// outputs += sum over `values` of value * weights[channel], `kPackets` packets of outputs at once.
//   weights: [C, C'];  outputs: [C']
template <typename Vectors, int kPackets>
void AddPixel(const Values::Value* values, int count, const float* weights, int channels,
              float* outputs) {
  using Vector = typename Vectors::Type;
  constexpr int kWidth = Vectors::kWidth;
  Vector sums[kPackets];
#pragma GCC unroll 8
  for (int p = 0; p < kPackets; ++p) sums[p] = simd::ploadu<Vector>(outputs + p * kWidth);
  for (int i = 0; i < count; ++i) {
    const Vector value = simd::pset1<Vector>(values[i].value);
    const float* weight = weights + values[i].channel * channels;
#pragma GCC unroll 8
    for (int p = 0; p < kPackets; ++p) {
      sums[p] = simd::pmadd(value, simd::ploadu<Vector>(weight + p * kWidth), sums[p]);
    }
  }
#pragma GCC unroll 8
  for (int p = 0; p < kPackets; ++p) simd::pstoreu(outputs + p * kWidth, sums[p]);
}

// All outputs of a pixel.
template <typename Vectors>
void AddOutputs(const Values::Value* values, int count, const float* weights, int channels,
                float* outputs) {
  using Adder = void (*)(const Values::Value*, int, const float*, int, float*);
  constexpr Adder kAdders[kMostPackets] = {
      AddPixel<Vectors, 1>, AddPixel<Vectors, 2>, AddPixel<Vectors, 3>, AddPixel<Vectors, 4>,
      AddPixel<Vectors, 5>, AddPixel<Vectors, 6>, AddPixel<Vectors, 7>, AddPixel<Vectors, 8>};
  constexpr int kWidth = Vectors::kWidth;
  for (int done = 0; done < channels;) {
    const int packets = std::min((channels - done) / kWidth, kMostPackets);
    kAdders[packets - 1](values, count, weights + done, channels, outputs + done);
    done += packets * kWidth;
  }
}

constexpr int kBlock = 64;  // bytes that are looked at together

// Whether nothing that is wanted of a block is filled.
bool IsBlack(const uint8_t* bytes, const uint8_t* wanted) {
  uint64_t filled = 0;
#pragma GCC unroll 8
  for (int i = 0; i < kBlock; i += static_cast<int>(sizeof(uint64_t))) {
    uint64_t eight = 0;
    uint64_t mask = 0;
    std::memcpy(&eight, bytes + i, sizeof(eight));
    std::memcpy(&mask, wanted + i, sizeof(mask));
    filled |= eight & mask;
  }
  return filled == 0;
}

}  // namespace

bool SparseConvolution::Takes(const artifact::BackboneLayer& layer) {
  return layer.kind == artifact::BackboneLayer::Kind::kConvolution && !layer.adds &&
         layer.output.channels % HalfPackets::kWidth == 0;
}

SparseConvolution::SparseConvolution(const artifact::BackboneLayer& layer,
                                     const FoldedConvolution& folded, int first_channel,
                                     double most_filled)
    : layer_(layer),
      most_(static_cast<size_t>(most_filled * layer.input.height * layer.input.width *
                                (layer.input.channels - first_channel))) {
  const int inputs = layer.input.channels;
  const int outputs = layer.output.channels;
  for (int i = 0; i < layer.input.width * inputs; ++i) {
    columns_.push_back(i / inputs);
    wanted_.push_back(i % inputs < first_channel ? 0 : 255);
  }
  wanted_.resize(wanted_.size() + sizeof(uint64_t));
  const int taps = layer.kernel * layer.kernel;
  weights_.resize(Eigen::Index{taps} * inputs * outputs);
  for (int o = 0; o < outputs; ++o) {
    for (int i = 0; i < inputs; ++i) {
      for (int tap = 0; tap < taps; ++tap) {
        weights_[(Eigen::Index{tap} * inputs + i) * outputs + o] =
            folded.weight[(static_cast<size_t>(o) * inputs + i) * taps + tap];
      }
    }
  }
}

bool SparseConvolution::Find(const uint8_t* raster, Values* values) const {
  const artifact::GridSize& input = layer_.input;
  const int row_bytes = input.width * input.channels;
  values->values.clear();
  values->pixels.clear();
  values->rows.assign(1, 0);
  for (int row = 0; row < input.height; ++row) {
    const uint8_t* const bytes = raster + static_cast<size_t>(row) * row_bytes;
    int last_column = -1;
    for (int begin = 0; begin < row_bytes; begin += static_cast<int>(sizeof(uint64_t))) {
      if (begin % kBlock == 0 && begin + kBlock <= row_bytes &&
          IsBlack(bytes + begin, &wanted_[begin])) {
        begin += kBlock - static_cast<int>(sizeof(uint64_t));
        continue;
      }
      uint64_t eight = 0;
      uint64_t wanted = 0;
      std::memcpy(&wanted, &wanted_[begin], sizeof(wanted));
      if (begin + static_cast<int>(sizeof(eight)) <= row_bytes) {
        std::memcpy(&eight, bytes + begin, sizeof(eight));
      } else {
        std::memcpy(&eight, bytes + begin, row_bytes - begin);
      }
      eight &= wanted;
      while (eight != 0) {
        const int place = begin + std::countr_zero(eight) / 8;
        const int column = columns_[place];
        const int count = static_cast<int>(values->values.size());
        if (column != last_column) values->pixels.push_back({column, count, count});
        last_column = column;
        values->values.push_back(
            {place - column * input.channels, static_cast<float>(bytes[place])});
        values->pixels.back().end = count + 1;
        eight &= ~(uint64_t{0xff} << (8 * (place - begin)));
      }
    }
    values->rows.push_back(static_cast<int>(values->pixels.size()));
    if (values->values.size() > most_) return false;
  }
  return true;
}

void SparseConvolution::AddTap(const Values& values, int row, int tap, float* sums) const {
  const int kernel = layer_.kernel;
  const int stride = layer_.stride;
  const int channels = layer_.output.channels;
  const auto add = channels % kPacket == 0 ? AddOutputs<WholePackets> : AddOutputs<HalfPackets>;
  for (int p = values.rows[row]; p < values.rows[row + 1]; ++p) {
    const Values::Pixel& pixel = values.pixels[p];
    const int from_left = pixel.column + kernel / 2;
    for (int column_tap = from_left % stride; column_tap < kernel; column_tap += stride) {
      const int column = (from_left - column_tap) / stride;
      if (from_left < column_tap || column >= layer_.output.width) continue;
      const float* weights = weights_.data() + Eigen::Index{tap * kernel + column_tap} *
                                                   layer_.input.channels * channels;
      add(&values.values[pixel.begin], pixel.end - pixel.begin, weights, channels,
          sums + static_cast<size_t>(column) * channels);
    }
  }
}

void SparseConvolution::AddRow(const Values& values, int row, float* sums) const {
  const int top = row * layer_.stride - layer_.kernel / 2;
  const int first = std::max(0, -top);
  const int last = std::min(layer_.kernel, layer_.input.height - top);
  for (int tap = first; tap < last; ++tap) AddTap(values, top + tap, tap, sums);
}

}  // namespace maneuver::inference
