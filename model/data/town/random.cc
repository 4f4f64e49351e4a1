#include "model/data/town/random.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include "model/data/stable_hash.h"

namespace maneuver::data::town {

Random::Random(uint64_t seed, uint64_t index, uint64_t stream) {
  uint64_t mix = SplitMix64(SplitMix64(seed) ^ index) ^ stream;
  for (uint64_t& word : state_) {
    word = SplitMix64(mix);
    mix += kSplitMixStep;
  }
}

uint64_t Random::Bits() {
  const uint64_t result = std::rotl(state_[1] * 5, 7) * 9;
  const uint64_t t = state_[1] << 17;
  state_[2] ^= state_[0];
  state_[3] ^= state_[1];
  state_[1] ^= state_[2];
  state_[0] ^= state_[3];
  state_[2] ^= t;
  state_[3] = std::rotl(state_[3], 45);
  return result;
}

double Random::Uniform(double low, double high) {
  return low + (high - low) * UnitInterval(Bits());
}

int Random::Integer(int low, int high) {
  const int drawn = low + static_cast<int>(Uniform(0.0, 1.0) * (high - low + 1));
  return std::min(drawn, high);
}

bool Random::Chance(double probability) { return Uniform(0.0, 1.0) < probability; }

double Random::Normal(double mean, double deviation) {
  const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform(0.0, 1.0)));
  return mean + deviation * radius * std::cos(2.0 * std::numbers::pi * Uniform(0.0, 1.0));
}

double Random::ClampedNormal(double mean, double deviation, double low, double high) {
  return std::clamp(Normal(mean, deviation), low, high);
}

double Random::Exponential(double mean) { return -mean * std::log(1.0 - Uniform(0.0, 1.0)); }

int Random::Choose(std::span<const double> weights) {
  double total = 0.0;
  for (const double weight : weights) total += weight;
  double left = Uniform(0.0, total);
  for (size_t i = 0; i < weights.size(); ++i) {
    left -= weights[i];
    if (left < 0.0) return static_cast<int>(i);
  }
  for (size_t i = weights.size(); i-- > 0;) {
    if (weights[i] > 0.0) return static_cast<int>(i);
  }
  return 0;
}

}  // namespace maneuver::data::town
