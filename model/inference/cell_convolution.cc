#include "model/inference/cell_convolution.h"

#ifdef __AVX512BF16__
#include <immintrin.h>
#endif

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <limits>

#include "model/inference/packet.h"

namespace maneuver::inference {
namespace {

namespace simd = Eigen::internal;
using Eigen::bfloat16;

// Sums that a processor's registers hold, beside the weights that they need.
constexpr int kSums = kPacket == 16 ? 24 : 12;
constexpr int kPacketChoices = 4;
constexpr int kMostCells = 8;
constexpr int CellsTogether(int packets) { return std::min(kSums / packets, kMostCells); }

// How many vectors of outputs are summed at a time, of so many in all.
int PacketsTogether(int packets) {
  for (const int together : {3, 4, 2}) {
    if (packets % together == 0) return together;
  }
  return 1;
}

// What a step of a chain multiplies: one input, or two that are bf16.
struct Single {
  using Value = float;
  static constexpr int kStep = 1;
  static Packet Everywhere(const float* input) { return simd::pset1<Packet>(*input); }
  static Packet MultiplyAdd(const Packet& inputs, const float* weights, const Packet& sums) {
    return simd::pmadd(inputs, simd::ploadu<Packet>(weights), sums);
  }
};
#ifdef __AVX512BF16__
struct Pair {
  using Value = bfloat16;
  static constexpr int kStep = 2;
  static Packet Everywhere(const bfloat16* inputs) {
    int32_t pair = 0;
    std::memcpy(&pair, inputs, sizeof(pair));
    return _mm512_castsi512_ps(_mm512_set1_epi32(pair));
  }
  static Packet MultiplyAdd(const Packet& inputs, const bfloat16* weights, const Packet& sums) {
    return _mm512_dpbf16_ps(sums, (__m512bh)inputs, (__m512bh)_mm512_loadu_ps(weights));
  }
};
constexpr bool kHasPairs = true;
void Store(const Packet& sums, bfloat16* outputs) { simd::pstoreu(outputs, simd::F32ToBf16(sums)); }
#else
constexpr bool kHasPairs = false;
#endif

void Store(const Packet& sums, float* outputs) { simd::pstoreu(outputs, sums); }

// A layer's figures.
struct Shape {
  int kernel;
  ptrdiff_t row_values;  // from an input row to the next one
  int steps;             // of a kernel row
  float least;           // of an output
};

// `kPackets` vectors of the outputs of a few cells.
//   weights: [k, steps, kPackets];  bias: [kPackets]
template <typename Step, typename Output, int kPackets>
void SumCells(const Shape& shape, const typename Step::Value* const* inputs,
              const typename Step::Value* weights, const float* bias, Output* const* outputs) {
  constexpr int kCells = CellsTogether(kPackets);
  constexpr int kWeights = Step::kStep * kPacket;
  Packet sums[kCells][kPackets];
#pragma GCC unroll 8
  for (int p = 0; p < kPackets; ++p) {
    sums[0][p] = simd::ploadu<Packet>(bias + p * kPacket);
#pragma GCC unroll 8
    for (int cell = 1; cell < kCells; ++cell) sums[cell][p] = sums[0][p];
  }
  for (int row = 0; row < shape.kernel; ++row) {
    const ptrdiff_t begin = row * shape.row_values;
    for (int step = 0; step < shape.steps; ++step, weights += kPackets * kWeights) {
      const ptrdiff_t at = begin + step * Step::kStep;
#pragma GCC unroll 8
      for (int cell = 0; cell < kCells; ++cell) {
        const Packet input = Step::Everywhere(inputs[cell] + at);
#pragma GCC unroll 8
        for (int p = 0; p < kPackets; ++p) {
          sums[cell][p] = Step::MultiplyAdd(input, weights + p * kWeights, sums[cell][p]);
        }
      }
    }
  }
  const Packet least = simd::pset1<Packet>(shape.least);
#pragma GCC unroll 8
  for (int cell = 0; cell < kCells; ++cell) {
#pragma GCC unroll 8
    for (int p = 0; p < kPackets; ++p) {
      Store(simd::pmax(sums[cell][p], least), outputs[cell] + p * kPacket);
    }
  }
}

// All outputs of all cells.
template <typename Step, typename Output, int kPackets>
void SumAll(const Shape& shape, const typename Step::Value* input,
            const typename Step::Value* weights, const Eigen::ArrayXf& bias,
            std::span<const CellConvolution::Cell> cells, Output* output) {
  constexpr int kCells = CellsTogether(kPackets);
  const ptrdiff_t group = ptrdiff_t{shape.kernel} * shape.steps * Step::kStep * kPackets * kPacket;
  for (size_t begin = 0; begin < cells.size(); begin += kCells) {
    const typename Step::Value* inputs[kCells];
    Output* outputs[kCells];
    for (size_t i = 0; i < kCells; ++i) {
      // The last one stands in for those that are missing.
      const CellConvolution::Cell& cell = cells[std::min(begin + i, cells.size() - 1)];
      inputs[i] = input + cell.input;
      outputs[i] = output + cell.output;
    }
    const typename Step::Value* group_weights = weights;
    for (Eigen::Index done = 0; done < bias.size(); done += kPackets * kPacket) {
      SumCells<Step, Output, kPackets>(shape, inputs, group_weights, bias.data() + done, outputs);
      for (Output*& cell : outputs) cell += kPackets * kPacket;
      group_weights += group;
    }
  }
}

template <typename Step, typename Output>
void SumAll(int packets, const Shape& shape, const void* input, const typename Step::Value* weights,
            const Eigen::ArrayXf& bias, std::span<const CellConvolution::Cell> cells,
            void* output) {
  using Value = typename Step::Value;
  using Summer = void (*)(const Shape&, const Value*, const Value*, const Eigen::ArrayXf&,
                          std::span<const CellConvolution::Cell>, Output*);
  constexpr Summer kSummers[kPacketChoices] = {SumAll<Step, Output, 1>, SumAll<Step, Output, 2>,
                                               SumAll<Step, Output, 3>, SumAll<Step, Output, 4>};
  kSummers[packets - 1](shape, static_cast<const Value*>(input), weights, bias, cells,
                        static_cast<Output*>(output));
}

}  // namespace

bool CellConvolution::Takes(const artifact::BackboneLayer& layer, bool bf16) {
  return layer.kind == artifact::BackboneLayer::Kind::kConvolution && !layer.adds &&
         layer.output.channels % kPacket == 0 &&
         (!bf16 || (kHasPairs && layer.input.channels % 2 == 0));
}

CellConvolution::CellConvolution(const artifact::BackboneLayer& layer,
                                 const FoldedConvolution& folded, bool bf16, bool narrow)
    : layer_(layer),
      bf16_(bf16),
      narrow_(narrow),
      weights_(static_cast<Eigen::Index>(folded.weight.size())),
      bias_(Eigen::Map<const Eigen::ArrayXf>(folded.bias.data(), layer.output.channels)) {
  const int step = bf16 ? 2 : 1;
  const int together = PacketsTogether(layer.output.channels / kPacket) * kPacket;
  const int taps = layer.kernel * layer.kernel;
  Eigen::Index place = 0;
  for (int first = 0; first < layer.output.channels; first += together) {
    for (int tap = 0; tap < taps; ++tap) {
      for (int input = 0; input < layer.input.channels; input += step) {
        for (int o = first; o < first + together; ++o) {
          for (int i = input; i < input + step; ++i) {
            weights_[place++] =
                folded.weight[(static_cast<size_t>(o) * layer.input.channels + i) * taps + tap];
          }
        }
      }
    }
  }
  if (bf16) {
    narrow_weights_ = weights_.cast<bfloat16>();
    weights_.resize(0);
  }
}

size_t CellConvolution::bytes() const {
  return static_cast<size_t>(weights_.size() + bias_.size()) * sizeof(float) +
         static_cast<size_t>(narrow_weights_.size()) * sizeof(bfloat16);
}

void CellConvolution::Evaluate(const void* input, ptrdiff_t row_values, std::span<const Cell> cells,
                               void* output) const {
  const Shape shape = {.kernel = layer_.kernel,
                       .row_values = row_values,
                       .steps = layer_.kernel * layer_.input.channels / (bf16_ ? 2 : 1),
                       .least = layer_.relu ? 0.0F : std::numeric_limits<float>::lowest()};
  const int packets = PacketsTogether(layer_.output.channels / kPacket);
#ifdef __AVX512BF16__
  if (bf16_) {
    (narrow_ ? SumAll<Pair, bfloat16> : SumAll<Pair, float>)(packets, shape, input,
                                                             narrow_weights_.data(), bias_, cells,
                                                             output);
    return;
  }
#endif
  SumAll<Single, float>(packets, shape, input, weights_.data(), bias_, cells, output);
}

}  // namespace maneuver::inference
