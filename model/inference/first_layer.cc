#include "model/inference/first_layer.h"

#include <Eigen/Core>
#include <limits>

#include "model/inference/packet.h"

namespace maneuver::inference {
namespace {

namespace simd = Eigen::internal;

// Where a larger share of the agents' channels is filled, multiplying all of them takes less time.
// Of recorded scenes 1 to 4 % is.
constexpr double kMostFilledF32 = 0.1;
constexpr double kMostFilledBf16 = 0.05;

// A row of sums as bf16 or as floats. `count` is a multiple of half a packet.
void Store(const float* sums, Eigen::Index count, bool relu, bool bf16, void* row) {
  using Vector = HalfPackets::Type;
  const Vector least = simd::pset1<Vector>(relu ? 0.0F : std::numeric_limits<float>::lowest());
  for (Eigen::Index i = 0; i < count; i += HalfPackets::kWidth) {
    const Vector values = simd::pmax(simd::ploadu<Vector>(sums + i), least);
    if (bf16) {
      simd::pstoreu(static_cast<Eigen::bfloat16*>(row) + i, simd::F32ToBf16(values));
    } else {
      simd::pstoreu(static_cast<float*>(row) + i, values);
    }
  }
}

}  // namespace

bool FirstLayer::Takes(const artifact::BackboneLayer& layer) {
  return MapConvolution::Takes(layer) && SparseConvolution::Takes(layer);
}

FirstLayer::FirstLayer(const artifact::BackboneLayer& layer, const FoldedConvolution& folded,
                       bool bf16)
    : layer_(layer),
      bf16_(bf16),
      map_(layer, folded),
      agents_(layer, folded, MapConvolution::kChannels, bf16 ? kMostFilledBf16 : kMostFilledF32) {}

bool FirstLayer::Evaluate(const uint8_t* raster, Scratch* scratch, void* grid) const {
  if (!agents_.Find(raster, &scratch->agents)) return false;
  const Eigen::Index row_values = Eigen::Index{layer_.output.width} * layer_.output.channels;
  scratch->sums.resize(static_cast<size_t>(row_values));
  float* const sums = scratch->sums.data();
  map_.Begin(&scratch->map);
  for (int row = 0; row < layer_.output.height; ++row) {
    map_.Row(raster, row, &scratch->map, sums);
    agents_.AddRow(scratch->agents, row, sums);
    const size_t size = bf16_ ? sizeof(Eigen::bfloat16) : sizeof(float);
    Store(sums, row_values, layer_.relu, bf16_,
          static_cast<std::byte*>(grid) + static_cast<size_t>(row * row_values) * size);
  }
  return true;
}

}  // namespace maneuver::inference
