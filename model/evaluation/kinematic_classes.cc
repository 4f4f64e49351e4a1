#include "model/evaluation/kinematic_classes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace maneuver::evaluation {
namespace {

using inference::Trajectory;
using Position = Eigen::RowVector2d;  // metres

constexpr double kUTurnHeadingChange = 2.0943951;  // radians: 120 degrees
constexpr double kCourseDistance = 1.0;            // metres

// Thresholds that depend on the agent's type.
struct Thresholds {
  double stationary_distance;          // metres
  double stationary_speed;             // m/s
  double u_turn_backwards;             // metres
  double lane_change_shift;            // metres
  std::array<double, 2> speed_limits;  // m/s
};
constexpr Thresholds kOfVehicles = {5.0, 2.0, -5.0, 2.0, {5.0, 10.0}};
constexpr Thresholds kOfPedestrians = {1.5, 0.5, -1.5, 1.0, {1.0, 2.0}};

double Course(const Position& from, const Position& to) {
  return std::atan2(to.y() - from.y(), to.x() - from.x());
}

double PathLength(const Trajectory& trajectory) {
  const Eigen::Index steps = trajectory.rows() - 1;
  return trajectory.row(0).norm() +
         (trajectory.bottomRows(steps) - trajectory.topRows(steps)).rowwise().norm().sum();
}

}  // namespace

std::string_view Name(KinematicClass kinematic_class) {
  return kKinematicClassNames[static_cast<size_t>(kinematic_class)];
}

double FinalHeadingChange(const Trajectory& trajectory) {
  const Position end = trajectory.row(trajectory.rows() - 1);
  double course = 0.0;
  bool moves = false;
  for (Eigen::Index t = trajectory.rows() - 2; t >= -1 && !moves; --t) {
    const Position before = t < 0 ? Position(0.0, 0.0) : Position(trajectory.row(t));
    moves = (end - before).norm() >= kCourseDistance;
    if (moves) course = Course(before, end);
  }
  if (!moves) return 0.0;
  if (SetsOffBackwards(trajectory)) course += std::numbers::pi;
  return std::remainder(course, 2.0 * std::numbers::pi);
}

bool SetsOffBackwards(const Trajectory& trajectory) {
  for (Eigen::Index t = 0; t < trajectory.rows(); ++t) {
    if (trajectory.row(t).norm() >= kCourseDistance) return trajectory(t, 0) < 0.0;
  }
  return false;
}

double SidewaysShift(const Trajectory& trajectory, double heading_change) {
  const Eigen::Index last = trajectory.rows() - 1;
  return trajectory(last, 1) - trajectory(last, 0) * std::tan(0.5 * heading_change);
}

KinematicClass Classify(const Trajectory& trajectory, std::span<const double> waypoint_times,
                        v1::AgentType type) {
  const Thresholds& limits = type == v1::AGENT_TYPE_PEDESTRIAN ? kOfPedestrians : kOfVehicles;
  const Eigen::Index last = trajectory.rows() - 1;
  const double dx = trajectory(last, 0);
  const double dy = trajectory(last, 1);
  const double first_speed = trajectory.row(0).norm() / waypoint_times[0];
  const double last_speed = last == 0 ? first_speed
                                      : (trajectory.row(last) - trajectory.row(last - 1)).norm() /
                                            (waypoint_times[static_cast<size_t>(last)] -
                                             waypoint_times[static_cast<size_t>(last) - 1]);
  if (std::hypot(dx, dy) < limits.stationary_distance &&
      std::max(first_speed, last_speed) < limits.stationary_speed) {
    return KinematicClass::kStationary;
  }
  const double heading_change = FinalHeadingChange(trajectory);
  if (std::abs(heading_change) >= kTurnHeadingChange) {
    if (std::abs(heading_change) >= kUTurnHeadingChange || dx < limits.u_turn_backwards) {
      return KinematicClass::kUTurn;
    }
    return heading_change > 0.0 ? KinematicClass::kLeftTurn : KinematicClass::kRightTurn;
  }
  const double shift = SidewaysShift(trajectory, heading_change);
  if (std::abs(shift) >= limits.lane_change_shift) {
    return shift > 0.0 ? KinematicClass::kLaneChangeLeft : KinematicClass::kLaneChangeRight;
  }
  const double speed = PathLength(trajectory) / waypoint_times.back();
  return speed < limits.speed_limits[0]   ? KinematicClass::kStraightSlow
         : speed < limits.speed_limits[1] ? KinematicClass::kStraightMedium
                                          : KinematicClass::kStraightFast;
}

}  // namespace maneuver::evaluation
