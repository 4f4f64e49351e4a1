#include "model/kernels/crc32c.h"

#include <array>
#include <cstddef>
#include <cstring>

#include "model/kernels/kernel_choice.h"

// Highway 1.0.3 has no CRC. SSE 4.2 has, which is part of x86-64-v3: no processor that runs this
// program lacks it.
#ifdef __SSE4_2__
#include <nmmintrin.h>
#endif

namespace maneuver::kernels {
namespace {

constexpr std::array<uint32_t, 256> MakeTable() {
  std::array<uint32_t, 256> table{};
  for (uint32_t byte = 0; byte < 256; ++byte) {
    uint32_t crc = byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1) != 0 ? 0x82F63B78u : 0u);
    table[byte] = crc;
  }
  return table;
}

constexpr std::array<uint32_t, 256> kTable = MakeTable();

uint32_t ExtendByTable(uint32_t crc, std::string_view bytes) {
  crc = ~crc;
  for (const char byte : bytes) {
    crc = kTable[(crc ^ static_cast<unsigned char>(byte)) & 0xFF] ^ (crc >> 8);
  }
  return ~crc;
}

#ifdef __SSE4_2__
uint32_t ExtendByInstruction(uint32_t crc, std::string_view bytes) {
  uint64_t state = ~crc;
  const char* data = bytes.data();
  size_t left = bytes.size();
  for (; left >= 8; data += 8, left -= 8) {
    uint64_t word;
    std::memcpy(&word, data, sizeof word);
    state = _mm_crc32_u64(state, word);
  }
  auto narrow = static_cast<uint32_t>(state);
  for (; left > 0; ++data, --left) {
    narrow = _mm_crc32_u8(narrow, static_cast<unsigned char>(*data));
  }
  return ~narrow;
}
#endif

}  // namespace

uint32_t ExtendCrc32c(uint32_t crc, std::string_view bytes) {
#ifdef __SSE4_2__
  if (!UsesPlainKernels()) return ExtendByInstruction(crc, bytes);
#endif
  return ExtendByTable(crc, bytes);
}

}  // namespace maneuver::kernels
