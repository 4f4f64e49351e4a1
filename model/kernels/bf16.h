// Converts bf16, held as its bits: the upper half of an IEEE float.

#ifndef MANEUVER_MODEL_KERNELS_BF16_H_
#define MANEUVER_MODEL_KERNELS_BF16_H_

#include <bit>
#include <cstdint>

namespace maneuver::kernels {

// Converts exactly.
inline float FromBf16(uint16_t bits) { return std::bit_cast<float>(uint32_t{bits} << 16); }

// Rounds to the nearest, ties to even. NaN stays NaN.
inline uint16_t ToBf16(float value) {
  const auto bits = std::bit_cast<uint32_t>(value);
  constexpr uint16_t kQuietNan = 0x7fc0;
  if (value != value) return kQuietNan;
  return static_cast<uint16_t>((bits + 0x7fff + (bits >> 16 & 1)) >> 16);
}

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_BF16_H_
