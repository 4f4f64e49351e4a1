#include "client/load/arrivals.h"

#include <cmath>

namespace maneuver::load {

double Uniform(std::mt19937_64& random) { return static_cast<double>(random() >> 11) * 0x1p-53; }

Arrivals::Arrivals(ArrivalProcess process, double rate, uint64_t seed)
    : process_(process), rate_(rate), random_(seed) {}

std::chrono::nanoseconds Arrivals::Next() {
  if (process_ == ArrivalProcess::kConstant) {
    // Not a sum of gaps, which would drift.
    seconds_ = static_cast<double>(calls_) / rate_;
  } else {
    seconds_ -= std::log1p(-Uniform(random_)) / rate_;
  }
  ++calls_;
  return std::chrono::nanoseconds(std::llround(seconds_ * 1e9));
}

}  // namespace maneuver::load
