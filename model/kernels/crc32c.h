// CRC-32C (Castagnoli): reflected polynomial 0x82F63B78, initial value and final xor all ones.

#ifndef MANEUVER_MODEL_KERNELS_CRC32C_H_
#define MANEUVER_MODEL_KERNELS_CRC32C_H_

#include <cstdint>
#include <string_view>

namespace maneuver::kernels {

// Returns the checksum of some bytes followed by `bytes`, where `crc` is the checksum of the former
// (0 if there are none). Uses the processor's instruction, or a table with plain kernels.
uint32_t ExtendCrc32c(uint32_t crc, std::string_view bytes);

inline uint32_t Crc32c(std::string_view bytes) { return ExtendCrc32c(0, bytes); }

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_CRC32C_H_
