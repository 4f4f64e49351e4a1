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
  // Of busy time: what was measured last holds while a worker is idle.
  constexpr double kMemorySeconds = 2.0;
  const double fading = std::exp(-seconds / kMemorySeconds);
  targets_ = fading * targets_ + batch.targets;
  seconds_ = fading * seconds_ + seconds;
  batch.targets = 0.0;
}

bool DrainRate::AllAtWork() const {
  return std::ranges::all_of(at_work_, [](const Batch& batch) { return batch.targets > 0.0; });
}

std::chrono::nanoseconds DrainRate::TimeForWorkBegun(TimePoint now) const {
  double seconds = 0.0;
  for (const Batch& batch : at_work_) {
    if (batch.targets == 0.0) continue;
    seconds += std::max(0.0, batch.targets * SecondsPerTarget() - SecondsBetween(batch.begin, now));
  }
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
      std::chrono::duration<double>(seconds / static_cast<double>(at_work_.size())));
}

std::chrono::nanoseconds DrainRate::TimeFor(int targets, TimePoint now) const {
  const double measured = SecondsPerTarget();
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
