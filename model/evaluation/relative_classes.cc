#include "model/evaluation/relative_classes.h"

#include <algorithm>
#include <cmath>

#include "model/evaluation/kinematic_classes.h"

namespace maneuver::evaluation {
namespace {

using inference::Trajectory;
using Position = Eigen::RowVector2d;  // metres

constexpr double kReversal = 2.3561945;              // radians: 135 degrees
constexpr double kStraightHeadingChange = 0.261799;  // radians: 15 degrees
constexpr double kEndSpeedTime = 0.5;                // seconds
constexpr double kRelativeSpeedChange = 0.15;

// Thresholds that depend on the agent's type.
struct RelativeThresholds {
  double standing_distance;  // metres
  double standing_speed;     // m/s; a start ends above it
  double stopped_speed;      // m/s
  double speed_change;       // m/s
  double lane_change_shift;  // metres
};
constexpr RelativeThresholds kRelativeOfVehicles = {2.0, 1.0, 0.5, 1.0, 2.0};
constexpr RelativeThresholds kRelativeOfPedestrians = {1.0, 0.5, 0.25, 0.5, 1.0};

// Returns the speed over the last half second, or over the last interval if that is longer, m/s.
double EndSpeed(const Trajectory& trajectory, std::span<const double> waypoint_times) {
  constexpr double kRounding = 1e-6;  // seconds
  const Eigen::Index last = trajectory.rows() - 1;
  const double end = waypoint_times[static_cast<size_t>(last)];
  Eigen::Index before = last - 1;
  const auto time = [&](Eigen::Index t) {
    return t < 0 ? 0.0 : waypoint_times[static_cast<size_t>(t)];
  };
  while (before >= 0 && end - time(before) < kEndSpeedTime - kRounding) --before;
  const Position from = before < 0 ? Position(0.0, 0.0) : Position(trajectory.row(before));
  return (trajectory.row(last) - from).norm() / (end - time(before));
}

}  // namespace

std::string_view Name(RelativeClass relative_class) {
  return kRelativeClassNames[static_cast<size_t>(relative_class)];
}

RelativeClass ClassifyRelative(const Trajectory& trajectory, std::span<const double> waypoint_times,
                               double present_speed, v1::AgentType type) {
  const RelativeThresholds& limits =
      type == v1::AGENT_TYPE_PEDESTRIAN ? kRelativeOfPedestrians : kRelativeOfVehicles;
  const bool standing = present_speed < limits.standing_speed;
  if (trajectory.rowwise().norm().maxCoeff() < limits.standing_distance) {
    return standing ? RelativeClass::kStands : RelativeClass::kStops;
  }
  const double heading_change = FinalHeadingChange(trajectory);
  if (std::abs(heading_change) >= kReversal) return RelativeClass::kUTurn;
  if (std::abs(heading_change) >= kTurnHeadingChange) {
    return heading_change > 0.0 ? RelativeClass::kTurnsLeft : RelativeClass::kTurnsRight;
  }
  const double shift = SidewaysShift(trajectory, heading_change);
  if (std::abs(heading_change) < kStraightHeadingChange &&
      std::abs(shift) >= limits.lane_change_shift) {
    return shift > 0.0 ? RelativeClass::kLaneChangeLeft : RelativeClass::kLaneChangeRight;
  }
  const double end_speed = EndSpeed(trajectory, waypoint_times);
  if (!standing && end_speed < limits.stopped_speed) return RelativeClass::kStops;
  if (standing && end_speed > limits.standing_speed) return RelativeClass::kStarts;
  const double change = end_speed - present_speed;
  if (std::abs(change) <= std::max(limits.speed_change, kRelativeSpeedChange * present_speed)) {
    return RelativeClass::kKeepsSpeed;
  }
  return change > 0.0 ? RelativeClass::kAccelerates : RelativeClass::kBrakes;
}

}  // namespace maneuver::evaluation
