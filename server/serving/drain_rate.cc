#include "server/serving/drain_rate.h"

#include <algorithm>
#include <cmath>

namespace maneuver::serving {
namespace {

double SecondsBetween(TimePoint begin, TimePoint end) {
  return std::chrono::duration<double>(end - begin).count();
}

}  // namespace

void DrainRate::Begin(int worker, size_t targets, TimePoint now) {
  at_work_[static_cast<size_t>(worker)] = {static_cast<double>(targets), now};
}

void DrainRate::End(int worker, TimePoint now) {
  Batch& batch = at_work_[static_cast<size_t>(worker)];
  const double seconds = SecondsBetween(batch.begin, now);
  // Of a worker's time. Idle time is none: what was measured last holds until there is work again.
  constexpr double kMemorySeconds = 2.0;
  const double fading = std::exp(-seconds / kMemorySeconds);
  targets_ = fading * targets_ + batch.targets;
  seconds_ = fading * seconds_ + seconds;
  batch.targets = 0.0;
}

std::chrono::nanoseconds DrainRate::TimeFor(int targets, TimePoint now) const {
  const double measured = targets_ > 0.0 ? seconds_ / targets_ : 0.0;
  double targets_per_second = 0.0;
  for (const Batch& batch : at_work_) {
    double seconds_per_target = measured;
    if (batch.targets > 0.0) {
      seconds_per_target =
          std::max(seconds_per_target, SecondsBetween(batch.begin, now) / batch.targets);
    }
    if (seconds_per_target <= 0.0) return std::chrono::nanoseconds(0);
    targets_per_second += 1.0 / seconds_per_target;
  }
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
      std::chrono::duration<double>(targets / targets_per_second));
}

}  // namespace maneuver::serving
