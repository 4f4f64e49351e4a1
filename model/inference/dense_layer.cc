#include "model/inference/dense_layer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <utility>

#include "model/inference/packet.h"

namespace maneuver::inference {
namespace {

constexpr int kPanel = 2 * kPacket;
constexpr size_t kAhead = 32;  // inputs from whose weights are fetched to those in use

// Else GCC reads weights from memory again for each row that they are multiplied with. With four
// rows that takes 1.4 times as long; with more there are no registers for it, with fewer less to
// gain.
inline void KeepInRegister(Packet& packet) {
#ifdef __x86_64__
  asm("" : "+x"(packet));
#else
  static_cast<void>(packet);
#endif
}

inline Packet Load(const float* weights) { return Eigen::internal::pload<Packet>(weights); }
inline Packet Load(const Eigen::bfloat16* weights) {
  using Narrow = Eigen::internal::packet_traits<Eigen::bfloat16>::type;
  return Eigen::internal::Bf16ToF32(Eigen::internal::pload<Narrow>(weights));
}
template <typename Weight>
constexpr int kPacketsOfLine = std::max<int>(1, 64 / (kPacket * sizeof(Weight)));

// Rows that are taken together, and panels: as many as registers hold the sums of. AVX-512 has 32,
// AVX2 16. Few rows take several panels, so that enough chains run to hide their latency.
constexpr int kMaxRows = kPacket == 16 ? 12 : 6;
constexpr int PanelsFor(int rows) { return rows == 1 ? 4 : rows <= 3 ? 2 : 1; }

// Rows of x and panels of outputs, at one place of each.
struct Operands {
  const float* x;          // [rows, inputs]
  const void* weights;     // [panels, inputs, kPanel] floats or bf16
  const float* bias;       // [panels, kPanel]
  const uint32_t* filled;  // the inputs that are not 0 in all rows
  size_t count;            // of those
  size_t inputs;
  Activation activation;
};

// `kRows` rows by `kPanels` panels held in registers. Sizes differ only in how many chains of
// multiply-adds run side by side, never in the order within one.
//
// All loops but that over the inputs are unrolled by name: at -O2 GCC leaves them as they are, and
// the sums in memory, which takes almost three times as long.
template <typename Weight, int kRows, int kPanels>
void ApplyTile(const Operands& operands, float* y /* [kRows, kPanels, kPanel] */) {
  namespace simd = Eigen::internal;
  constexpr int kPackets = 2 * kPanels;
  Packet sums[kRows][kPackets];
#pragma GCC unroll 12
  for (int p = 0; p < kPackets; ++p) {
    const Packet bias = simd::pload<Packet>(operands.bias + p * kPacket);
#pragma GCC unroll 12
    for (int r = 0; r < kRows; ++r) sums[r][p] = bias;
  }
  const size_t inputs = operands.inputs;
  const Weight* const all_weights = static_cast<const Weight*>(operands.weights);
  for (size_t n = 0; n < operands.count; ++n) {
    const size_t i = operands.filled[n];
#pragma GCC unroll 12
    for (int p = 0; p < kPackets; p += kPacketsOfLine<Weight>) {
      const size_t panel = static_cast<size_t>(p / 2) * inputs + operands.filled[n + kAhead];
      __builtin_prefetch(all_weights + panel * kPanel + (p % 2) * kPacket);
    }
    Packet weights[kPackets];
#pragma GCC unroll 12
    for (int p = 0; p < kPackets; ++p) {
      const size_t panel = static_cast<size_t>(p / 2) * inputs + i;
      weights[p] = Load(all_weights + panel * kPanel + (p % 2) * kPacket);
      if constexpr (kRows == 4) KeepInRegister(weights[p]);
    }
#pragma GCC unroll 12
    for (int r = 0; r < kRows; ++r) {
      const Packet x = simd::pset1<Packet>(operands.x[static_cast<size_t>(r) * inputs + i]);
#pragma GCC unroll 12
      for (int p = 0; p < kPackets; ++p) sums[r][p] = simd::pmadd(x, weights[p], sums[r][p]);
    }
  }
  const Packet zero = simd::pset1<Packet>(0.0f);
#pragma GCC unroll 12
  for (int r = 0; r < kRows; ++r) {
#pragma GCC unroll 12
    for (int p = 0; p < kPackets; ++p) {
      if (operands.activation == Activation::kRelu) sums[r][p] = simd::pmax(sums[r][p], zero);
      simd::pstoreu(y + (r * kPackets + p) * kPacket, sums[r][p]);
    }
  }
}

// Which inputs are not 0 in all `rows`, in their order.
//   filled: room for all inputs and kAhead;  bits: scratch, likewise
size_t FindFilled(const float* x, int rows, int inputs, uint32_t* bits, uint32_t* filled) {
  int done = 0;
  for (; done + kPacket <= inputs; done += kPacket) {
    Packet any = Eigen::internal::ploadu<Packet>(x + done);
    for (int r = 1; r < rows; ++r) {
      any = Eigen::internal::por(
          any, Eigen::internal::ploadu<Packet>(x + static_cast<Eigen::Index>(r) * inputs + done));
    }
    std::memcpy(bits + done, &any, sizeof(any));
  }
  for (; done < inputs; ++done) {
    bits[done] = 0;
    for (int r = 0; r < rows; ++r) {
      bits[done] |= std::bit_cast<uint32_t>(x[static_cast<Eigen::Index>(r) * inputs + done]);
    }
  }
  size_t count = 0;
  for (int i = 0; i < inputs; ++i) {
    filled[count] = static_cast<uint32_t>(i);
    count += bits[i] != 0 ? 1 : 0;
  }
  std::fill_n(filled + count, kAhead, 0);
  return count;
}

using Tile = void (*)(const Operands&, float*);
constexpr int kMaxPanels = 4;

// The tiles of 1 to `kRows` rows, `kPanels` panels each (as many as registers hold, if fewer).
template <typename Weight, int kPanels, size_t... kRows>
constexpr std::array<Tile, sizeof...(kRows)> TilesOf(std::index_sequence<kRows...>) {
  return {ApplyTile<Weight, kRows + 1, std::min(kPanels, PanelsFor(kRows + 1))>...};
}
template <typename Weight>
constexpr auto kWideTiles = TilesOf<Weight, kMaxPanels>(std::make_index_sequence<kMaxRows>{});
template <typename Weight>
constexpr auto kNarrowTiles = TilesOf<Weight, 1>(std::make_index_sequence<kMaxRows>{});

}  // namespace

DenseLayer::DenseLayer(int inputs, int outputs, const float* weight, const float* bias, bool bf16)
    : inputs_(inputs), outputs_(outputs) {
  const Eigen::Index panels = (outputs + kPanel - 1) / kPanel;
  Eigen::ArrayXf packed = Eigen::ArrayXf::Zero(panels * inputs * kPanel);
  bias_ = Eigen::ArrayXf::Zero(panels * kPanel);
  for (Eigen::Index o = 0; o < outputs; ++o) {
    bias_[o] = bias[o] + 0.0f;  // never -0, which the product with an input of 0 would make 0
    for (Eigen::Index i = 0; i < inputs; ++i) {
      packed[(o / kPanel * inputs + i) * kPanel + o % kPanel] = weight[o * inputs + i];
    }
  }
  if (bf16) {
    narrow_panels_ = packed.cast<Eigen::bfloat16>();
  } else {
    panels_ = std::move(packed);
  }
}

void DenseLayer::Apply(const float* x, int rows, Activation activation, DenseScratch* scratch,
                       float* y) const {
  if (rows == 0) return;  // as when no action is to be described
  const size_t inputs = static_cast<size_t>(inputs_);
  const int blocks = (rows + kMaxRows - 1) / kMaxRows;
  const auto begin_of = [&](int block) {
    return rows * block / blocks;
  };  // 13 rows are 6 and 7, not 12 and 1
  scratch->bits.resize(inputs);
  const size_t room = inputs + kAhead;
  scratch->filled.resize(static_cast<size_t>(blocks) * room);
  scratch->counts.resize(static_cast<size_t>(blocks));
  for (int block = 0; block < blocks; ++block) {
    scratch->counts[static_cast<size_t>(block)] =
        FindFilled(x + static_cast<Eigen::Index>(begin_of(block)) * inputs_,
                   begin_of(block + 1) - begin_of(block), inputs_, scratch->bits.data(),
                   scratch->filled.data() + static_cast<size_t>(block) * room);
  }

  const bool bf16 = narrow_panels_.size() > 0;
  const int panels = static_cast<int>(bias_.size()) / kPanel;
  const int tallest = (rows + blocks - 1) / blocks;
  float tile[kMaxRows * kMaxPanels * kPanel];
  // Panels outside, rows inside: a panel stays in cache for all rows.
  for (int panel = 0, width = 0; panel < panels; panel += width) {
    // All rows take the width of the tallest block.
    width = PanelsFor(tallest) <= panels - panel ? PanelsFor(tallest) : 1;
    const int begin = panel * kPanel;
    const Eigen::Index place_of_panel = Eigen::Index{panel} * inputs_ * kPanel;
    const int count = std::min(width * kPanel, outputs_ - begin);
    for (int block = 0; block < blocks; ++block) {
      const int row = begin_of(block);
      const int height = begin_of(block + 1) - row;
      const size_t place = static_cast<size_t>(block);
      const Operands operands = {
          x + static_cast<Eigen::Index>(row) * inputs_,
          bf16 ? static_cast<const void*>(narrow_panels_.data() + place_of_panel)
               : panels_.data() + place_of_panel,
          bias_.data() + Eigen::Index{panel} * kPanel,
          scratch->filled.data() + place * room,
          scratch->counts[place],
          inputs,
          activation};
      const bool wide = width == PanelsFor(height);
      const size_t last = static_cast<size_t>(height - 1);
      if (bf16) {
        (wide ? kWideTiles<Eigen::bfloat16> : kNarrowTiles<Eigen::bfloat16>)[last](operands, tile);
      } else {
        (wide ? kWideTiles<float> : kNarrowTiles<float>)[last](operands, tile);
      }
      for (int r = 0; r < height; ++r) {
        std::copy_n(tile + r * width * kPanel, count,
                    y + static_cast<Eigen::Index>(row + r) * outputs_ + begin);
      }
    }
  }
}

size_t Mlp::bytes() const {
  size_t bytes = 0;
  for (const DenseLayer& layer : layers_) bytes += layer.bytes();
  return bytes;
}

void Mlp::Apply(const float* x, int rows, MlpScratch* scratch, float* y) const {
  for (size_t i = 0; i + 1 < layers_.size(); ++i) {
    scratch->back.resize(static_cast<size_t>(rows) * static_cast<size_t>(layers_[i].outputs()));
    layers_[i].Apply(x, rows, Activation::kRelu, &scratch->dense, scratch->back.data());
    std::swap(scratch->front, scratch->back);
    x = scratch->front.data();
  }
  layers_.back().Apply(x, rows, Activation::kNone, &scratch->dense, y);
}

}  // namespace maneuver::inference
