#include "model/kernels/dense_layer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

#include "model/kernels/bf16.h"
#include "model/kernels/kernel_choice.h"

// What follows is compiled once for each target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "model/kernels/dense_layer.cc"
#include <hwy/foreach_target.h>
// It must come after foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace maneuver::kernels::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Floats = hn::ScalableTag<float>;
using Vector = hn::Vec<Floats>;
constexpr int kLanes = hn::MaxLanes(Floats());

constexpr int kPanel = 2 * kLanes;
constexpr size_t kAhead = 32;  // from the inputs in use to those whose weights are fetched

// Else GCC reads weights from memory again for each row that they are multiplied with. With four
// rows that takes 1.4 times as long; with more there are no registers for it, with fewer less to
// gain.
HWY_INLINE void KeepInRegister(Vector& vector) {
#if HWY_ARCH_X86_64
  asm("" : "+x"(vector.raw));
#else
  static_cast<void>(vector);
#endif
}

HWY_INLINE Vector LoadWeights(const float* weights) { return hn::Load(Floats(), weights); }
HWY_INLINE Vector LoadWeights(const uint16_t* weights) {
  const hn::Rebind<uint16_t, Floats> halves;
  const hn::RebindToUnsigned<Floats> words;
  return hn::BitCast(Floats(), hn::ShiftLeft<16>(hn::PromoteTo(words, hn::Load(halves, weights))));
}
template <typename Weight>
constexpr int kVectorsOfLine = std::max<int>(1, 64 / (kLanes * sizeof(Weight)));

// Rows that are taken together, and panels: as many as registers hold the sums of. AVX-512 has 32,
// AVX2 16. Few rows take several panels, so that enough chains run to hide their latency.
constexpr int kMaxRows = kLanes == 16 ? 12 : 6;
constexpr int PanelsFor(int rows) { return rows == 1 ? 4 : rows <= 3 ? 2 : 1; }

// Rows of x and panels of outputs, at one place of each.
struct Operands {
  const float* x;           // [rows, inputs]
  const void* weights;      // [panels, inputs, kPanel] floats or bf16
  const float* bias;        // [panels, kPanel]
  const uint32_t* nonzero;  // the inputs that are not 0 in all rows
  size_t count;             // of those
  size_t inputs;
  Activation activation;
};

// Computes `kRows` rows by `kPanels` panels, held in registers. Sizes differ only in how many
// chains of multiply-adds run side by side, never in the order within one.
//
// All loops but that over the inputs are unrolled by name: at -O2 GCC leaves them as they are, and
// the sums in memory, which takes almost three times as long.
//   y: [kRows, stride], of which the first kPanels * kPanel numbers of each row are written
template <typename Weight, int kRows, int kPanels>
void ApplyTile(const Operands& operands, size_t stride, float* y) {
  const Floats d;
  constexpr int kVectors = 2 * kPanels;
  Vector sums[kRows][kVectors];
#pragma GCC unroll 12
  for (int v = 0; v < kVectors; ++v) {
    const Vector bias = hn::Load(d, operands.bias + v * kLanes);
#pragma GCC unroll 12
    for (int r = 0; r < kRows; ++r) sums[r][v] = bias;
  }
  const size_t inputs = operands.inputs;
  const Weight* const all_weights = static_cast<const Weight*>(operands.weights);
  for (size_t n = 0; n < operands.count; ++n) {
    const size_t i = operands.nonzero[n];
#pragma GCC unroll 12
    for (int v = 0; v < kVectors; v += kVectorsOfLine<Weight>) {
      const size_t panel = static_cast<size_t>(v / 2) * inputs + operands.nonzero[n + kAhead];
      __builtin_prefetch(all_weights + panel * kPanel + (v % 2) * kLanes);
    }
    Vector weights[kVectors];
#pragma GCC unroll 12
    for (int v = 0; v < kVectors; ++v) {
      const size_t panel = static_cast<size_t>(v / 2) * inputs + i;
      weights[v] = LoadWeights(all_weights + panel * kPanel + (v % 2) * kLanes);
      if constexpr (kRows == 4) KeepInRegister(weights[v]);
    }
#pragma GCC unroll 12
    for (int r = 0; r < kRows; ++r) {
      const Vector x = hn::Set(d, operands.x[static_cast<size_t>(r) * inputs + i]);
#pragma GCC unroll 12
      for (int v = 0; v < kVectors; ++v) sums[r][v] = hn::MulAdd(x, weights[v], sums[r][v]);
    }
  }
  const Vector zero = hn::Zero(d);
#pragma GCC unroll 12
  for (int r = 0; r < kRows; ++r) {
#pragma GCC unroll 12
    for (int v = 0; v < kVectors; ++v) {
      // In this order NaN stays NaN.
      if (operands.activation == Activation::kRelu) sums[r][v] = hn::Max(zero, sums[r][v]);
      hn::StoreU(sums[r][v], d, y + static_cast<size_t>(r) * stride + v * kLanes);
    }
  }
}

// Finds the inputs that are not 0 in all `rows`, in their order. Returns how many.
//   nonzero: room for all inputs and kAhead
size_t FindNonzero(const float* x, int rows, int inputs, uint32_t* nonzero) {
  const Floats d;
  const hn::RebindToUnsigned<Floats> words;
  static_assert(kLanes <= static_cast<int>(kAhead));
  size_t count = 0;
  int i = 0;
  auto places = hn::Iota(words, 0);  // once: it takes an instruction for each lane
  for (; i + kLanes <= inputs; i += kLanes) {
    Vector any = hn::LoadU(d, x + i);
    for (int r = 1; r < rows; ++r) {
      any = hn::Or(any, hn::LoadU(d, x + static_cast<ptrdiff_t>(r) * inputs + i));
    }
    const auto found = hn::Ne(hn::BitCast(words, any), hn::Zero(words));
    // Not CompressStore, which takes some processors a hundred cycles.
    hn::StoreU(hn::Compress(places, found), words, nonzero + count);
    count += hn::CountTrue(words, found);
    places = hn::Add(places, hn::Set(words, kLanes));
  }
  for (; i < inputs; ++i) {
    uint32_t any = 0;
    for (int r = 0; r < rows; ++r) {
      any |= std::bit_cast<uint32_t>(x[static_cast<ptrdiff_t>(r) * inputs + i]);
    }
    nonzero[count] = static_cast<uint32_t>(i);
    count += any != 0 ? 1 : 0;
  }
  std::fill_n(nonzero + count, kAhead, 0);
  return count;
}

using Tile = void (*)(const Operands&, size_t, float*);
constexpr int kMaxPanels = 4;

// The tiles of 1 to `kRows` rows, `kPanels` panels each (as many as registers hold, if fewer).
template <typename Weight, int kPanels, size_t... kRows>
constexpr std::array<Tile, sizeof...(kRows)> TilesOf(std::index_sequence<kRows...>) {
  return {ApplyTile<Weight, kRows + 1, std::min(kPanels, PanelsFor(kRows + 1))>...};
}
template <typename Weight, int kPanels>
constexpr auto kTiles = TilesOf<Weight, kPanels>(std::make_index_sequence<kMaxRows>{});

// Returns the tile of at most PanelsFor(rows) panels.
template <typename Weight>
Tile TileOf(int rows, int panels) {
  const size_t last = static_cast<size_t>(rows - 1);
  return panels == 1   ? kTiles<Weight, 1>[last]
         : panels == 2 ? kTiles<Weight, 2>[last]
                       : kTiles<Weight, kMaxPanels>[last];
}

void Apply(const DensePanels& weights, const float* x, int rows, Activation activation,
           DenseScratch* scratch, float* y) {
  if (rows == 0) return;  // as when no action is to be described
  const size_t inputs = static_cast<size_t>(weights.inputs);
  const int blocks = (rows + kMaxRows - 1) / kMaxRows;
  const auto begin_of = [&](int block) {
    return rows * block / blocks;
  };  // 13 rows are 6 and 7, not 12 and 1
  const size_t room = inputs + kAhead;
  scratch->nonzero.resize(static_cast<size_t>(blocks) * room);
  scratch->counts.resize(static_cast<size_t>(blocks));
  for (int block = 0; block < blocks; ++block) {
    scratch->counts[static_cast<size_t>(block)] = FindNonzero(
        x + static_cast<size_t>(begin_of(block)) * inputs, begin_of(block + 1) - begin_of(block),
        weights.inputs, scratch->nonzero.data() + static_cast<size_t>(block) * room);
  }

  const bool bf16 = !weights.narrow.empty();
  const int panels = static_cast<int>(weights.bias.size()) / kPanel;
  const int tallest = (rows + blocks - 1) / blocks;
  float tile[kMaxRows * kMaxPanels * kPanel];
  // Panels outside, rows inside: a panel stays in cache for all rows.
  for (int panel = 0, width = 0; panel < panels; panel += width) {
    // All rows take the width of the tallest block. Of fewer panels that are left, 2 or 1.
    width = PanelsFor(tallest);
    while (width > panels - panel) width /= 2;
    const int begin = panel * kPanel;
    const size_t place_of_panel = static_cast<size_t>(panel) * inputs * kPanel;
    const int count = std::min(width * kPanel, weights.outputs - begin);
    for (int block = 0; block < blocks; ++block) {
      const int row = begin_of(block);
      const int height = begin_of(block + 1) - row;
      const size_t place = static_cast<size_t>(block);
      const Operands operands = {
          x + static_cast<size_t>(row) * inputs,
          bf16 ? static_cast<const void*>(weights.narrow.data() + place_of_panel)
               : weights.wide.data() + place_of_panel,
          weights.bias.data() + static_cast<size_t>(panel) * kPanel,
          scratch->nonzero.data() + place * room,
          scratch->counts[place],
          inputs,
          activation};
      const Tile apply = bf16 ? TileOf<uint16_t>(height, width) : TileOf<float>(height, width);
      const size_t outputs = static_cast<size_t>(weights.outputs);
      float* const to = y + static_cast<size_t>(row) * outputs + begin;
      if (count == width * kPanel) {
        apply(operands, outputs, to);
        continue;
      }
      // The last panel has room for more outputs than there are.
      apply(operands, static_cast<size_t>(width * kPanel), tile);
      for (int r = 0; r < height; ++r) {
        std::copy_n(tile + r * width * kPanel, count, to + static_cast<size_t>(r) * outputs);
      }
    }
  }
}

const DenseKernel* Kernel() {
  static constexpr DenseKernel kKernel = {.panel = kPanel, .apply = Apply};
  return &kKernel;
}

}  // namespace
}  // namespace maneuver::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace maneuver::kernels {
namespace {

constexpr int kPlainPanel = 16;

// Sums one row of x with one panel, and stores the `count` outputs that exist.
template <typename Weight, typename Widen>
void ApplyPanel(const float* x, int inputs, const Weight* weights, const float* bias,
                const Widen& widen, Activation activation, int count, float* y) {
  float sums[kPlainPanel];
  std::copy_n(bias, kPlainPanel, sums);
  for (int i = 0; i < inputs; ++i, weights += kPlainPanel) {
    for (int o = 0; o < kPlainPanel; ++o) sums[o] = std::fma(x[i], widen(weights[o]), sums[o]);
  }
  for (int o = 0; o < count; ++o) {
    y[o] = activation == Activation::kRelu && sums[o] < 0.0F ? 0.0F : sums[o];
  }
}

void ApplyPlain(const DensePanels& panels, const float* x, int rows, Activation activation,
                DenseScratch* /*scratch*/, float* y) {
  for (int row = 0; row < rows; ++row, x += panels.inputs, y += panels.outputs) {
    for (int first = 0; first < panels.outputs; first += kPlainPanel) {
      const int count = std::min(kPlainPanel, panels.outputs - first);
      const size_t place = static_cast<size_t>(first) * static_cast<size_t>(panels.inputs);
      const float* const bias = panels.bias.data() + first;
      if (panels.narrow.empty()) {
        ApplyPanel(
            x, panels.inputs, panels.wide.data() + place, bias, [](float weight) { return weight; },
            activation, count, y + first);
      } else {
        ApplyPanel(x, panels.inputs, panels.narrow.data() + place, bias, FromBf16, activation,
                   count, y + first);
      }
    }
  }
}

constexpr DenseKernel kPlain = {.panel = kPlainPanel, .apply = ApplyPlain};

HWY_EXPORT(Kernel);

}  // namespace

DenseLayer::DenseLayer(int inputs, int outputs, const float* weight, const float* bias, bool bf16)
    : kernel_(UsesPlainKernels() ? &kPlain : HWY_DYNAMIC_DISPATCH(Kernel)()),
      panels_{.inputs = inputs, .outputs = outputs, .wide = {}, .narrow = {}, .bias = {}} {
  const int panel = kernel_->panel;
  const size_t padded = static_cast<size_t>((outputs + panel - 1) / panel * panel);
  panels_.bias.resize(padded);
  panels_.wide.resize(padded * static_cast<size_t>(inputs));
  for (int o = 0; o < outputs; ++o) {
    // Never -0, which the product with an input of 0 would make 0.
    panels_.bias[static_cast<size_t>(o)] = bias[o] + 0.0F;
    for (int i = 0; i < inputs; ++i) {
      const size_t line = static_cast<size_t>(o / panel) * inputs + i;
      panels_.wide[line * panel + o % panel] = weight[ptrdiff_t{o} * inputs + i];
    }
  }
  if (!bf16) return;
  panels_.narrow.resize(panels_.wide.size());
  std::ranges::transform(panels_.wide, panels_.narrow.begin(), ToBf16);
  panels_.wide = {};
}

}  // namespace maneuver::kernels
#endif  // HWY_ONCE
