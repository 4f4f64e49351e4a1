// Classifies what a driver does beyond the present motion, by the present speed and the trajectory.
//
// A kinematic class (kinematic_classes.h) says where a trajectory leads: fast and slow straight
// driving are two classes. A relative class says what changes: both are "keeps speed". Actions that
// are relative to the present motion are compared with these classes.

#ifndef MANEUVER_MODEL_EVALUATION_RELATIVE_CLASSES_H_
#define MANEUVER_MODEL_EVALUATION_RELATIVE_CLASSES_H_

#include <array>
#include <span>
#include <string_view>

#include "maneuver/v1/scenario.pb.h"
#include "model/inference/trajectory_set.h"

namespace maneuver::evaluation {

enum class RelativeClass {
  kStands,
  kStops,
  kStarts,
  kKeepsSpeed,
  kAccelerates,
  kBrakes,
  kTurnsLeft,
  kTurnsRight,
  kUTurn,
  kLaneChangeLeft,
  kLaneChangeRight,
};

// The names of the classes, in their order.
inline constexpr std::array<std::string_view, 11> kRelativeClassNames = {
    "stands",     "stops",       "starts", "keeps_speed",      "accelerates",      "brakes",
    "turns_left", "turns_right", "u_turn", "lane_change_left", "lane_change_right"};

std::string_view Name(RelativeClass relative_class);

// Returns the first class that applies. v is `present_speed`, e the speed at the end, r the largest
// distance of a waypoint from the origin, h FinalHeadingChange and d SidewaysShift
// (kinematic_classes.h).
//
//   stands, stops       r < 2 m; stands if v < 1 m/s
//   U-turn              |h| >= 135 degrees
//   turns left, right   |h| >= 30 degrees, by the sign of h
//   lane change         |h| < 15 degrees and |d| >= 2 m, by the sign of d
//   stops               v >= 1 m/s and e < 0.5 m/s
//   starts              v < 1 m/s and e > 1 m/s
//   accelerates, brakes |e - v| > max(1 m/s, 0.15 v), by the sign of e - v
//   keeps speed         otherwise
//
// Below 2 m of movement, the course cannot be told from noise, so the turns do not apply. r is used
// instead of the path's length, to which noise adds at every waypoint. For the same reason, e is
// the distance of the last waypoint from the position half a second earlier, divided by that time.
//
// For pedestrians, all distances and speeds are halved. All other types have the figures above.
//   trajectory: [T, 2] target frame, metres
//   waypoint_times: [T] seconds, increasing
//   present_speed: at the prediction time, m/s
//   type: the type of the agent
RelativeClass ClassifyRelative(const inference::Trajectory& trajectory,
                               std::span<const double> waypoint_times, double present_speed,
                               v1::AgentType type = v1::AGENT_TYPE_VEHICLE);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_RELATIVE_CLASSES_H_
