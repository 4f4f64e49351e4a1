// Classifies what a trajectory does by its shape alone. Actions are compared with these classes
// when nobody recorded manoeuvres.
//
// The classes and most thresholds are those of the Waymo motion benchmark's trajectory types. Three
// things differ: straight driving is divided by speed and by keeping or changing the lane; headings
// are those of the course, because positions have no other; and a U-turn needs no eight seconds.

#ifndef MANEUVER_MODEL_EVALUATION_KINEMATIC_CLASSES_H_
#define MANEUVER_MODEL_EVALUATION_KINEMATIC_CLASSES_H_

#include <array>
#include <span>
#include <string_view>

#include "maneuver/v1/scenario.pb.h"
#include "model/inference/trajectory_set.h"

namespace maneuver::evaluation {

enum class KinematicClass {
  kStationary,
  kStraightSlow,    // mean speed of a vehicle below 5 m/s
  kStraightMedium,  // below 10 m/s
  kStraightFast,
  kLeftTurn,
  kRightTurn,
  kUTurn,
  kLaneChangeLeft,
  kLaneChangeRight,
};

// The names of the classes, in their order.
inline constexpr std::array<std::string_view, 9> kKinematicClassNames = {
    "stationary", "straight_slow", "straight_medium",  "straight_fast",    "left_turn",
    "right_turn", "u_turn",        "lane_change_left", "lane_change_right"};

std::string_view Name(KinematicClass kinematic_class);

// Returns the course at the end relative to +x, radians in (-pi, pi], counter-clockwise. The course
// at the end is the direction of the last metre or more of travel. It is 0 if the trajectory moves
// less than a metre. If the trajectory starts backwards, the rear's direction counts instead.
//   trajectory: target frame, starts at the origin along +x.
double FinalHeadingChange(const inference::Trajectory& trajectory);

// Returns whether the first metre of travel goes to the rear.
//   trajectory: target frame
bool SetsOffBackwards(const inference::Trajectory& trajectory);

// Returns how far the end is to the left (positive) of where an arc with the same heading change
// ends, metres. With (dx, dy) the last waypoint and h = `heading_change`, that is dy - dx tan(h /
// 2), because an arc's chord points along h / 2.
//   trajectory: target frame
//   heading_change: FinalHeadingChange(trajectory); less than pi
double SidewaysShift(const inference::Trajectory& trajectory, double heading_change);

// Returns the first class that applies. (dx, dy) is the last waypoint, h the final heading change:
//   stationary       |(dx, dy)| < 5 m, and speeds in the first and the last interval < 2 m/s
//   U-turn           |h| >= 120 degrees, or |h| >= 30 degrees and dx < -5 m
//   left, right turn |h| >= 30 degrees, by the sign of h
//   lane change      |SidewaysShift| >= 2 m, by its sign
//   straight         by the mean speed along the path: slow, from 5 m/s medium, from 10 m/s fast
// By these thresholds a pedestrian would nearly always be stationary or slow. Pedestrians have 1.5
// m and 0.5 m/s (stationary), -1.5 m (U-turn), 1 m (a step aside instead of the lane change), 1 and
// 2 m/s (stroll, walk, run). All other types have those of vehicles.
//
// No threshold depends on the horizon. Within 3 s few lane changes are complete, and a slow vehicle
// may count as stationary.
//   waypoint_times: [T] seconds
//   type: the type of the agent
KinematicClass Classify(const inference::Trajectory& trajectory,
                        std::span<const double> waypoint_times,
                        v1::AgentType type = v1::AGENT_TYPE_VEHICLE);

// Smallest |h| of a turn, radians: 30 degrees.
inline constexpr double kTurnHeadingChange = 0.523599;

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_KINEMATIC_CLASSES_H_
