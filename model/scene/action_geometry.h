// How the trajectories of actions lie to the lane paths of a target: what actions that look at the
// lanes read.

#ifndef MANEUVER_MODEL_SCENE_ACTION_GEOMETRY_H_
#define MANEUVER_MODEL_SCENE_ACTION_GEOMETRY_H_

#include <array>
#include <span>

#include "model/scene/lane_path_inputs.h"

namespace maneuver::scene {

inline constexpr int kGeometryTimes = 3;
inline constexpr int kPairNumbers = 18;    // of an action and a lane path
inline constexpr int kActionNumbers = 13;  // of an action

// When actions are looked at: at 0.4, 0.7 and 1 of the horizon, and half a second before each for
// their velocity. Indices of the nearest waypoints; -1 for the prediction time itself. `before` is
// always earlier than `at`. The earlier waypoint counts where two are as near.
struct GeometryWaypoints {
  std::array<int, kGeometryTimes> at;
  std::array<int, kGeometryTimes> before;
  std::array<double, kGeometryTimes> times;  // of `at`, seconds
  std::array<double, kGeometryTimes> steps;  // from `before` to `at`, seconds
};
GeometryWaypoints FindGeometryWaypoints(std::span<const double> waypoint_times);

// Where one action's trajectory is at those times, target frame, metres.
struct ActionPoints {
  std::array<std::array<float, 2>, kGeometryTimes> at;      // x, y
  std::array<std::array<float, 2>, kGeometryTimes> before;  // x, y
};

// Writes the numbers of K actions.
//
// Velocity at each time: u = (at - before) / step; direction d = u / |u|, or (1, 0) below 0.5 m/s.
//
// A lane path is the polyline through the foot of the target on it and its 13 points
// (lane_paths.h), straight on beyond both ends. For an action at one of the times, its nearest
// segment gives: signed distance to the line of the segment (l, left is positive), distance to the
// segment, arc length s from the foot (the nominal arc length of the segment's start plus what is
// along the segment), and the segment's direction p, (1, 0) for a segment shorter than 1 mm.
//
// Beside a bend, the segments that meet there are as near. The first one counts, robustly: a later
// segment is nearer only if its squared distance is less by 1e-4 of it and 1e-5 square metres.
//
// An action's numbers are the same bits whatever other actions there are.
//
//   pairs [K, 6, 18], 0 where there is no path:
//     0-2    l / 3 m at the three times, held within -2 .. 2
//     3-5    e^(-distance / 1 m)
//     6-8    sine of the angle from p to d
//     9      its cosine at the last time
//     10     s / 50 m at the last time
//     11     what is left of the path beyond it, / 50 m
//     12-14  (where the leader is, at its present speed, less s) / 10 m, held within -2 .. 3; 0
//            without a leader
//     15     1 with a leader, else 0
//     16-17  (the stop line's distance less s) / 10 m at the first and last time, held within
//            -2 .. 2; 0 without one
//   actions [K, 13]:
//     0-1    last position / (50 m, 20 m)        2-3    first position / (20 m, 10 m)
//     4-6    speeds / 15 m/s                     7-10   d at the second and last time
//     11     (last speed - present speed) / 10 m/s
//     12     e^(-last speed / 1 m/s)
//
//   speed: of the target along its heading now, m/s
void DescribeActions(std::span<const ActionPoints> trajectories, const GeometryWaypoints& waypoints,
                     const LanePathInputs& paths, double speed, std::span<float> pairs,
                     std::span<float> actions);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_ACTION_GEOMETRY_H_
