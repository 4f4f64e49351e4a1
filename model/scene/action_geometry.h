// Describes how the trajectories of actions lie relative to a target's lane paths, as numbers for
// the networks.

#ifndef MANEUVER_MODEL_SCENE_ACTION_GEOMETRY_H_
#define MANEUVER_MODEL_SCENE_ACTION_GEOMETRY_H_

#include <array>
#include <span>

#include "model/scene/lane_path_inputs.h"

namespace maneuver::scene {

inline constexpr int kGeometryTimes = 3;
inline constexpr int kPairNumbers = 18;    // of an action and a lane path
inline constexpr int kActionNumbers = 13;  // of an action

// The times at which an action's trajectory is read: 0.4, 0.7 and 1 of the horizon. `before` is
// half a second earlier, for the velocity. The entries are indices of the nearest waypoints, the
// earlier one of two that are equally near; -1 stands for the prediction time. `before` is always
// earlier than `at`.
struct GeometryWaypoints {
  std::array<int, kGeometryTimes> at;
  std::array<int, kGeometryTimes> before;
  std::array<double, kGeometryTimes> times;  // of `at`, seconds
  std::array<double, kGeometryTimes> steps;  // from `before` to `at`, seconds
};
GeometryWaypoints FindGeometryWaypoints(std::span<const double> waypoint_times);

// The positions of one action's trajectory at those times, target frame, metres.
struct ActionPoints {
  std::array<std::array<float, 2>, kGeometryTimes> at;      // x, y
  std::array<std::array<float, 2>, kGeometryTimes> before;  // x, y
};

// Writes the numbers that describe K actions.
//
// Velocity at each time: u = (at - before) / step. Direction d = u / |u|, or (1, 0) below 0.5 m/s.
//
// A lane path is a polyline: the target's foot on it, then its 13 points (lane_paths.h). It
// continues straight beyond both ends. The foot is put 2.5 m before the first point, in the mean of
// the path's directions at the foot and at that point, which is exact for lines and nearly so for
// arcs. With version 1 of the inputs (inputs_version.h) it is put beside the target, although a
// lane may begin or end up to 5 m ahead of it or behind it.
//
// For an action at one of the times, the nearest segment of a path gives
//
//   - the signed distance l to the segment's line, positive to the left,
//   - the distance to the segment,
//   - the arc length s from the foot: the nominal arc length at the segment's start, plus the
//     distance along the segment,
//   - the segment's direction p; (1, 0) for a segment shorter than 1 mm.
//
// Two segments that meet in a bend can be equally near. The first one counts, and rounding must not
// change that: a later segment replaces it only if its squared distance is smaller by more than
// 1e-4 of the squared distance so far plus 1e-5 square metres.
//
// The numbers of an action are the same bits whatever the other actions are.
//
//   pairs [K, 6, 18], 0 where there is no path. "Clamped" means limited to the range given:
//     0-2    l / 3 m at the three times, clamped to -2 .. 2
//     3-5    e^(-distance / 1 m)
//     6-8    sine of the angle from p to d
//     9      its cosine at the last time
//     10     s / 50 m at the last time
//     11     the length of path that remains beyond that point, / 50 m
//     12-14  (the gap to the leader, plus what it drives until each of the three times at its
//            present speed, minus s) / 10 m, clamped to -2 .. 3; 0 without a leader
//     15     1 with a leader, else 0
//     16-17  (arc length of the stop sign minus s) / 10 m at the first and last time, clamped to
//            -2 .. 2; 0 without a stop sign
//   actions [K, 13]:
//     0-1    last position / (50 m, 20 m)        2-3    first position / (20 m, 10 m)
//     4-6    speeds / 15 m/s                     7-10   d at the second and last time
//     11     (last speed - present speed) / 10 m/s
//     12     e^(-last speed / 1 m/s)
//
//   speed: present speed of the target along its heading, m/s
void DescribeActions(std::span<const ActionPoints> trajectories, const GeometryWaypoints& waypoints,
                     const LanePathInputs& paths, double speed, int inputs_version,
                     std::span<float> pairs, std::span<float> actions);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_ACTION_GEOMETRY_H_
