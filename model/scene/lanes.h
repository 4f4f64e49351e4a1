// Eight neighbouring pixels of a row at once, or four points: GCC's and Clang's vector extensions,
// which become whatever vectors the processor has.

#ifndef MANEUVER_MODEL_SCENE_LANES_H_
#define MANEUVER_MODEL_SCENE_LANES_H_

#ifdef __AVX__
#include <immintrin.h>
#endif

#include <cmath>
#include <cstdint>
#include <cstring>
#include <span>

#include "model/scene/raster.h"

namespace maneuver::scene {

inline constexpr int kLanes = Raster::kLanes;

using FloatLanes = float __attribute__((vector_size(kLanes * sizeof(float))));
using IntLanes = int32_t __attribute__((vector_size(kLanes * sizeof(int32_t))));
using ByteLanes = uint8_t __attribute__((vector_size(kLanes)));

inline constexpr int kPointLanes = 4;
using DoubleLanes = double __attribute__((vector_size(kPointLanes * sizeof(double))));
using MaskLanes = int64_t __attribute__((vector_size(kPointLanes * sizeof(int64_t))));

inline constexpr MaskLanes kPointIndex = {0, 1, 2, 3};

inline bool AnyOf(MaskLanes mask) {
#ifdef __AVX__
  return _mm256_movemask_pd(reinterpret_cast<__m256d>(mask)) != 0;
#else
  return (mask[0] | mask[1] | mask[2] | mask[3]) != 0;
#endif
}

inline constexpr FloatLanes kLaneIndex = {0, 1, 2, 3, 4, 5, 6, 7};

inline FloatLanes Broadcast(float value) { return value + FloatLanes{}; }

template <typename Lanes>
inline Lanes Least(Lanes a, Lanes b) {
  return a < b ? a : b;
}
template <typename Lanes>
inline Lanes Most(Lanes a, Lanes b) {
  return a > b ? a : b;
}
inline FloatLanes Within(FloatLanes a, float low, float high) {
  return Most(Broadcast(low), Least(a, Broadcast(high)));
}
template <typename Lanes>
inline Lanes Magnitude(Lanes a) {
  return Most(a, -a);
}

// Returns whether each value lies within -limit and limit; NaN does not.
inline bool AllWithin(std::span<const double> values, double limit) {
  MaskLanes good = ~MaskLanes{};
  size_t i = 0;
  for (; i + kPointLanes <= values.size(); i += kPointLanes) {
    DoubleLanes four;
    std::memcpy(&four, values.data() + i, sizeof(four));
    good &= Magnitude(four) <= limit;
  }
  bool all = !AnyOf(~good);
  for (; i < values.size(); ++i) all &= std::abs(values[i]) <= limit;
  return all;
}

inline FloatLanes SquareRoot(FloatLanes a) {
  for (int lane = 0; lane < kLanes; ++lane) a[lane] = std::sqrt(a[lane]);
  return a;
}

// Paints over eight pixels, of which each becomes the brighter of what it is and `value`, rounded.
//   value: 0 to 255.
inline void PaintOver(FloatLanes value, uint8_t* pixels) {
  using Bytes = uint8_t __attribute__((vector_size(kLanes * sizeof(int32_t))));
  // The low byte of each number.
  const auto bytes = reinterpret_cast<Bytes>(__builtin_convertvector(value + 0.5F, IntLanes));
  const ByteLanes painted = __builtin_shufflevector(bytes, bytes, 0, 4, 8, 12, 16, 20, 24, 28);
  ByteLanes seen;
  std::memcpy(&seen, pixels, kLanes);
  seen = seen > painted ? seen : painted;
  std::memcpy(pixels, &seen, kLanes);
}

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_LANES_H_
