// CRC-32C (Castagnoli): reflected polynomial 0x82F63B78, initial value and final xor all ones.

#ifndef MANEUVER_MODEL_DATA_CRC32C_H_
#define MANEUVER_MODEL_DATA_CRC32C_H_

#include <cstdint>
#include <string_view>

namespace maneuver::data {

// The checksum of the bytes that `crc` is the checksum of (0: none), followed by `bytes`. Uses the
// processor's instruction where the build allows it.
uint32_t ExtendCrc32c(uint32_t crc, std::string_view bytes);

// The same by a table, on any processor.
uint32_t ExtendCrc32cByTable(uint32_t crc, std::string_view bytes);

inline uint32_t Crc32c(std::string_view bytes) { return ExtendCrc32c(0, bytes); }

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_CRC32C_H_
