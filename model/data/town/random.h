// Random numbers that are the same on every machine: xoshiro256** with its own distributions. Those
// of the standard library differ between implementations.

#ifndef MANEUVER_MODEL_DATA_TOWN_RANDOM_H_
#define MANEUVER_MODEL_DATA_TOWN_RANDOM_H_

#include <array>
#include <cstdint>
#include <span>

namespace maneuver::data::town {

class Random {
 public:
  // Makes a stream of numbers that is independent for each (seed, index, stream).
  Random(uint64_t seed, uint64_t index, uint64_t stream);

  uint64_t Bits();
  // Returns a number in [low, high).
  double Uniform(double low, double high);
  // Returns an integer in low .. high, both included.
  int Integer(int low, int high);
  bool Chance(double probability);
  //   deviation: standard deviation
  double Normal(double mean, double deviation);
  // Returns a normal number, clamped to the bounds.
  double ClampedNormal(double mean, double deviation, double low, double high);
  double Exponential(double mean);
  // Returns an index with probability proportional to its weight. At least one weight must be
  // positive.
  int Choose(std::span<const double> weights);

 private:
  std::array<uint64_t, 4> state_;
};

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_RANDOM_H_
