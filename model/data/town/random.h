// Random numbers that are the same on every machine: xoshiro256** and distributions of our own (the
// standard library's differ between implementations).

#ifndef MANEUVER_MODEL_DATA_TOWN_RANDOM_H_
#define MANEUVER_MODEL_DATA_TOWN_RANDOM_H_

#include <array>
#include <cstdint>
#include <span>

namespace maneuver::data::town {

class Random {
 public:
  // Independent streams for different (seed, index, stream).
  Random(uint64_t seed, uint64_t index, uint64_t stream);

  uint64_t Bits();
  double Uniform(double low, double high);
  // An integer of low..high, both included.
  int Integer(int low, int high);
  bool Chance(double probability);
  double Normal(double mean, double deviation);
  // Normal, redrawn into the nearest bound.
  double ClampedNormal(double mean, double deviation, double low, double high);
  double Exponential(double mean);
  // An index with probability proportional to its weight. Some weight must be positive.
  int Choose(std::span<const double> weights);

 private:
  std::array<uint64_t, 4> state_;
};

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_RANDOM_H_
