#include "model/scene/motion_reference.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace maneuver::scene {
namespace {

constexpr double kLongestStep = 0.1;  // seconds

// least_speed: v(t) is not below it, m/s
void RollOutFading(const MotionEstimate& motion, double least_speed,
                   std::span<const double> waypoint_times, std::span<double> reference) {
  const double acceleration =
      std::clamp(motion.acceleration, -kMostAcceleration, kMostAcceleration);
  const double turn_rate = std::clamp(motion.turn_rate, -kMostTurnRate, kMostTurnRate);
  double time = 0.0;
  double speed = motion.speed;
  double heading = 0.0;
  double x = 0.0;
  double y = 0.0;
  for (size_t i = 0; i < waypoint_times.size(); ++i) {
    const double start = time;
    // Slightly less, so that 0.1 s with its rounding error takes one step.
    const int steps =
        std::max(1, static_cast<int>(std::ceil((waypoint_times[i] - start) / kLongestStep - 1e-6)));
    const double step = (waypoint_times[i] - start) / steps;
    for (int j = 1; j <= steps; ++j) {
      time = start + j * step;
      const double faded = kMotionFades * (1.0 - std::exp(-time / kMotionFades));
      const double next_speed = std::max(least_speed, motion.speed + acceleration * faded);
      const double next_heading = turn_rate * faded;
      const double mean_speed = 0.5 * (speed + next_speed);
      const double mean_heading = 0.5 * (heading + next_heading);
      x += mean_speed * std::cos(mean_heading) * step;
      y += mean_speed * std::sin(mean_heading) * step;
      speed = next_speed;
      heading = next_heading;
    }
    time = waypoint_times[i];
    reference[2 * i] = x;
    reference[2 * i + 1] = y;
  }
}

double LeastSpeed(double speed, int inputs_version) {
  if (speed > 0.0) return 0.0;
  return inputs_version < 2 ? -std::numeric_limits<double>::infinity() : speed;
}

}  // namespace

void RollOut(v1::TrajectoryReference kind, int inputs_version, const MotionEstimate& motion,
             std::span<const double> waypoint_times, std::span<double> reference) {
  switch (kind) {
    case v1::TRAJECTORY_REFERENCE_FADING_MOTION:
      RollOutFading(motion, LeastSpeed(motion.speed, inputs_version), waypoint_times, reference);
      return;
    case v1::TRAJECTORY_REFERENCE_CONSTANT_VELOCITY:
      for (size_t i = 0; i < waypoint_times.size(); ++i) {
        reference[2 * i] = motion.speed * waypoint_times[i];
        reference[2 * i + 1] = 0.0;
      }
      return;
    default:
      std::fill(reference.begin(), reference.end(), 0.0);
  }
}

}  // namespace maneuver::scene
