// Determines when calls are due, whatever happens to earlier calls.

#ifndef MANEUVER_CLIENT_LOAD_ARRIVALS_H_
#define MANEUVER_CLIENT_LOAD_ARRIVALS_H_

#include <chrono>
#include <cstdint>
#include <random>

namespace maneuver::load {

enum class ArrivalProcess {
  kPoisson,   // independent, exponential gaps: callers who do not know of each other
  kConstant,  // equal gaps, the first call at once
};

// Returns a random number in [0, 1) with 53 bits, the same on every platform.
double Uniform(std::mt19937_64& random);

// The due times of one load run. The same seed gives the same times. Not thread-safe.
class Arrivals {
 public:
  //   rate: calls per second, > 0
  Arrivals(ArrivalProcess process, double rate, uint64_t seed);

  // Returns when the next call is due, counted from the start of the load run. Never decreases.
  std::chrono::nanoseconds Next();

 private:
  const ArrivalProcess process_;
  const double rate_;
  std::mt19937_64 random_;
  int64_t calls_ = 0;
  double seconds_ = 0.0;
};

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_ARRIVALS_H_
