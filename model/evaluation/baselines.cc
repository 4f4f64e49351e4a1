#include "model/evaluation/baselines.h"

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "model/scene/inputs_version.h"
#include "model/scene/motion_reference.h"
#include "model/scene/pose2.h"
#include "model/scene/target_frame.h"
#include "model/scene/target_history.h"

namespace maneuver::evaluation {
namespace {

constexpr double kPast = 1.0;  // seconds

// Returns the least-squares slope of values over times; 0 if all times are equal.
double Slope(const std::vector<double>& times, const std::vector<double>& values) {
  const auto count = static_cast<double>(times.size());
  double mean_time = 0.0;
  double mean_value = 0.0;
  for (size_t i = 0; i < times.size(); ++i) {
    mean_time += times[i] / count;
    mean_value += values[i] / count;
  }
  double covariance = 0.0;
  double variance = 0.0;
  for (size_t i = 0; i < times.size(); ++i) {
    covariance += (times[i] - mean_time) * (values[i] - mean_value);
    variance += (times[i] - mean_time) * (times[i] - mean_time);
  }
  return variance > 0.0 ? covariance / variance : 0.0;
}

double SpeedAlongHeading(const v1::AgentState& state) {
  const double heading = state.heading();
  return std::cos(heading) * state.velocity_x() + std::sin(heading) * state.velocity_y();
}

}  // namespace

double Motion::speed() const { return std::hypot(velocity_x, velocity_y); }

Motion MotionAt(const v1::Agent& agent, double time) {
  const int now = scene::FindState(agent, time, scene::kSameTime, time + scene::kSameTime);
  const v1::AgentState& present = agent.states(now);
  const scene::Point2 velocity = scene::Pose2(0.0, 0.0, present.heading())
                                     .ToLocal({present.velocity_x(), present.velocity_y()});
  std::vector<double> times;
  std::vector<double> speeds;
  std::vector<double> headings;  // unwrapped, backwards from the present
  for (int i = now; i >= 0; --i) {
    const v1::AgentState& state = agent.states(i);
    if (state.time() < time - kPast - scene::kSameTime) break;
    times.push_back(state.time() - time);
    speeds.push_back(SpeedAlongHeading(state));
    const double heading = state.heading();
    const double last = headings.empty() ? heading : headings.back();
    headings.push_back(last + std::remainder(heading - last, 2.0 * std::numbers::pi));
  }
  return {.velocity_x = velocity.x,
          .velocity_y = velocity.y,
          .acceleration = Slope(times, speeds),
          .turn_rate = Slope(times, headings)};
}

Trajectory ConstantVelocity(const Motion& motion, std::span<const double> waypoint_times) {
  Trajectory trajectory(waypoint_times.size(), 2);
  for (size_t i = 0; i < waypoint_times.size(); ++i) {
    trajectory.row(static_cast<Eigen::Index>(i)) << motion.velocity_x * waypoint_times[i],
        motion.velocity_y * waypoint_times[i];
  }
  return trajectory;
}

Trajectory ConstantTurnRateAndAcceleration(const Motion& motion,
                                           std::span<const double> waypoint_times) {
  // Below this the arc is a parabola: its third-order terms are under a millimetre in 10 s.
  constexpr double kStraight = 1e-4;  // rad/s
  const double v = motion.velocity_x;
  const double a = motion.acceleration;
  const double w = motion.turn_rate;
  double stop = v * a < 0.0 ? -v / a : std::numeric_limits<double>::infinity();
  if (v == 0.0 && a < 0.0) stop = 0.0;
  Trajectory trajectory(waypoint_times.size(), 2);
  for (size_t i = 0; i < waypoint_times.size(); ++i) {
    const double t = std::min(waypoint_times[i], stop);
    double x = v * t + 0.5 * a * t * t;
    double y = w * (0.5 * v * t * t + a * t * t * t / 3.0);
    if (std::abs(w) > kStraight) {
      const double end_speed = v + a * t;
      const double cosine = std::cos(w * t);
      const double sine = std::sin(w * t);
      x = end_speed * sine / w + a * (cosine - 1.0) / (w * w);
      y = (v - end_speed * cosine) / w + a * sine / (w * w);
    }
    trajectory.row(static_cast<Eigen::Index>(i)) << x, y;
  }
  return trajectory;
}

Trajectory FadedRollOut(const v1::Agent& agent, double time, const scene::Pose2& X_WT,
                        std::span<const double> waypoint_times) {
  Trajectory trajectory(waypoint_times.size(), 2);
  scene::RollOut(v1::TRAJECTORY_REFERENCE_FADING_MOTION, scene::kLatestInputsVersion,
                 scene::EstimateMotion(scene::ResampleHistory(agent, time, X_WT)), waypoint_times,
                 {trajectory.data(), static_cast<size_t>(trajectory.size())});
  return trajectory;
}

}  // namespace maneuver::evaluation
