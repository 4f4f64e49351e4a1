#include "model/inference/dense_layer.h"

#include <algorithm>
#include <utility>

#include "model/inference/packet.h"

namespace maneuver::inference {
namespace {

constexpr int kPanel = 2 * kPacket;

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

// Rows of x and panels of outputs, at one place of each.
struct Operands {
  const float* x;        // [rows, inputs]
  const float* weights;  // [panels, inputs, kPanel]
  const float* bias;     // [panels, kPanel]
  int inputs;
  Activation activation;
};

// `kRows` rows by `kPanels` panels held in registers. Sizes differ only in how many chains of
// multiply-adds run side by side, never in the order within one.
//
// All loops but that over the inputs are unrolled by name: at -O2 GCC leaves them as they are, and
// the sums in memory, which takes almost three times as long.
template <int kRows, int kPanels>
void ApplyTile(const Operands& operands, float* y /* [kRows, kPanels, kPanel] */) {
  namespace simd = Eigen::internal;
  constexpr int kPackets = 2 * kPanels;
  Packet sums[kRows][kPackets];
#pragma GCC unroll 8
  for (int p = 0; p < kPackets; ++p) {
    const Packet bias = simd::pload<Packet>(operands.bias + p * kPacket);
#pragma GCC unroll 8
    for (int r = 0; r < kRows; ++r) sums[r][p] = bias;
  }
  const size_t inputs = static_cast<size_t>(operands.inputs);
  for (size_t i = 0; i < inputs; ++i) {
    Packet weights[kPackets];
#pragma GCC unroll 8
    for (int p = 0; p < kPackets; ++p) {
      const size_t panel = static_cast<size_t>(p / 2) * inputs + i;
      weights[p] = simd::pload<Packet>(operands.weights + panel * kPanel + (p % 2) * kPacket);
      if constexpr (kRows == 4) KeepInRegister(weights[p]);
    }
#pragma GCC unroll 8
    for (int r = 0; r < kRows; ++r) {
      const Packet x = simd::pset1<Packet>(operands.x[static_cast<size_t>(r) * inputs + i]);
#pragma GCC unroll 8
      for (int p = 0; p < kPackets; ++p) sums[r][p] = simd::pmadd(x, weights[p], sums[r][p]);
    }
  }
  const Packet zero = simd::pset1<Packet>(0.0f);
#pragma GCC unroll 8
  for (int r = 0; r < kRows; ++r) {
#pragma GCC unroll 8
    for (int p = 0; p < kPackets; ++p) {
      if (operands.activation == Activation::kRelu) sums[r][p] = simd::pmax(sums[r][p], zero);
      simd::pstoreu(y + (r * kPackets + p) * kPacket, sums[r][p]);
    }
  }
}

using Tile = void (*)(const Operands&, float*);
constexpr int kMaxRows = 6;
constexpr int kMaxPanels = 4;
// By rows, from 1. Few rows take several panels, so that enough chains run to hide their latency.
constexpr Tile kWideTiles[kMaxRows] = {ApplyTile<1, 4>, ApplyTile<2, 2>, ApplyTile<3, 2>,
                                       ApplyTile<4, 1>, ApplyTile<5, 1>, ApplyTile<6, 1>};
constexpr int kWidePanels[kMaxRows] = {4, 2, 2, 1, 1, 1};
constexpr Tile kNarrowTiles[kMaxRows] = {ApplyTile<1, 1>, ApplyTile<2, 1>, ApplyTile<3, 1>,
                                         ApplyTile<4, 1>, ApplyTile<5, 1>, ApplyTile<6, 1>};

}  // namespace

DenseLayer::DenseLayer(int inputs, int outputs, const float* weight, const float* bias)
    : inputs_(inputs), outputs_(outputs) {
  const Eigen::Index panels = (outputs + kPanel - 1) / kPanel;
  panels_ = Eigen::ArrayXf::Zero(panels * inputs * kPanel);
  bias_ = Eigen::ArrayXf::Zero(panels * kPanel);
  for (Eigen::Index o = 0; o < outputs; ++o) {
    bias_[o] = bias[o];
    for (Eigen::Index i = 0; i < inputs; ++i) {
      panels_[(o / kPanel * inputs + i) * kPanel + o % kPanel] = weight[o * inputs + i];
    }
  }
}

void DenseLayer::Apply(const float* x, int rows, Activation activation, float* y) const {
  if (rows == 0) return;  // as when no action is to be described
  const int panels = static_cast<int>(bias_.size()) / kPanel;
  float tile[kMaxRows * kMaxPanels * kPanel];
  // Panels outside, rows inside: a panel stays in cache for all rows.
  for (int panel = 0, width = 0; panel < panels; panel += width) {
    width = 0;
    for (int row = 0, height = 0; row < rows; row += height) {
      const int tiles_left = (rows - row + kMaxRows - 1) / kMaxRows;
      height = (rows - row + tiles_left - 1) / tiles_left;  // 7 rows are 4 and 3, not 6 and 1
      // All rows take the width of the first tile, the tallest.
      if (width == 0)
        width = kWidePanels[height - 1] <= panels - panel ? kWidePanels[height - 1] : 1;
      const Operands operands = {x + static_cast<Eigen::Index>(row) * inputs_,
                                 panels_.data() + Eigen::Index{panel} * inputs_ * kPanel,
                                 bias_.data() + Eigen::Index{panel} * kPanel, inputs_, activation};
      const bool wide = width == kWidePanels[height - 1];
      (wide ? kWideTiles : kNarrowTiles)[height - 1](operands, tile);
      const int begin = panel * kPanel;
      const int count = std::min(width * kPanel, outputs_ - begin);
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
    layers_[i].Apply(x, rows, Activation::kRelu, scratch->back.data());
    std::swap(scratch->front, scratch->back);
    x = scratch->front.data();
  }
  layers_.back().Apply(x, rows, Activation::kNone, y);
}

}  // namespace maneuver::inference
