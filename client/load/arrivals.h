// When calls are due, whatever becomes of those before them.

#ifndef MANEUVER_CLIENT_LOAD_ARRIVALS_H_
#define MANEUVER_CLIENT_LOAD_ARRIVALS_H_

#include <chrono>
#include <cstdint>
#include <random>

namespace maneuver::load {

enum class ArrivalProcess {
  kPoisson,   // gaps of independent exponential length: callers who know nothing of one another
  kConstant,  // equal gaps, the first call at once
};

// A random number in [0, 1) with 53 bits: the same from the same generator everywhere.
double Uniform(std::mt19937_64& random);

// The due times of one run. The same seed gives the same times. Not thread-safe.
class Arrivals {
 public:
  //   rate: calls a second, > 0.
  Arrivals(ArrivalProcess process, double rate, uint64_t seed);

  // When the next call is due, from the start of the run; does not decrease.
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
