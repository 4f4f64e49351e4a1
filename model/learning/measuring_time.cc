#include "model/learning/measuring_time.h"

#include <algorithm>
#include <utility>

namespace maneuver::learning {
namespace {

constexpr double kEnough = 1.0;  // seconds

}  // namespace

MeasuringTime::MeasuringTime(TrainingProgress::Clock clock)
    : clock_(std::move(clock)), begun_(clock_()) {}

bool MeasuringTime::Continue(int64_t done, int64_t total) {
  last_ = {std::chrono::duration<double>(clock_() - begun_).count(), done};
  total_ = total;
  if (!first_) first_ = last_;
  return last_.seconds - first_->seconds < kEnough;
}

std::optional<double> MeasuringTime::SecondsOf(int64_t examples) const {
  if (!first_ || last_.done <= first_->done) return std::nullopt;
  const double example =
      (last_.seconds - first_->seconds) / static_cast<double>(last_.done - first_->done);
  const double before = first_->seconds - example * static_cast<double>(first_->done);
  return std::max(0.0, before) + example * static_cast<double>(examples);
}

}  // namespace maneuver::learning
