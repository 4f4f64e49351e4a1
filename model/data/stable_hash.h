// A hash that is the same on every machine and in every version. It decides which recordings are
// held out and which examples are kept. Never change it.

#ifndef MANEUVER_MODEL_DATA_STABLE_HASH_H_
#define MANEUVER_MODEL_DATA_STABLE_HASH_H_

#include <cstdint>
#include <string_view>

namespace maneuver::data {

// FNV-1a, 64 bits.
constexpr uint64_t StableHash(std::string_view bytes) {
  uint64_t hash = 0xCBF29CE484222325u;
  for (const char byte : bytes) {
    hash = (hash ^ static_cast<unsigned char>(byte)) * 0x100000001B3u;
  }
  return hash;
}

// What SplitMix64 adds to its state before each output.
inline constexpr uint64_t kSplitMixStep = 0x9E3779B97F4A7C15u;

// Returns the output of SplitMix64 (Steele, Lea and Flood, 2014) that follows a state: well mixed
// bits, even of a counter.
constexpr uint64_t SplitMix64(uint64_t state) {
  uint64_t z = state + kSplitMixStep;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
  return z ^ (z >> 31);
}

// Mixes a number into a hash.
constexpr uint64_t MixHash(uint64_t hash, uint64_t value) { return SplitMix64(hash ^ value); }

// Maps a hash to a number in [0, 1), by its upper 53 bits.
constexpr double UnitInterval(uint64_t hash) { return static_cast<double>(hash >> 11) * 0x1p-53; }

// Returns the id of an agent that its recording names by a text: 52 bits, so that JSON's numbers
// hold it.
constexpr int64_t AgentId(std::string_view name) {
  return static_cast<int64_t>(MixHash(StableHash(name), 0) >> 12);
}

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_STABLE_HASH_H_
