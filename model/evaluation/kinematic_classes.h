// What a trajectory does, told from its shape alone: where nobody recorded manoeuvres, actions are
// held against these.
//
// The classes and most thresholds are those of the Waymo motion benchmark's trajectory types. Apart
// from it, straight driving is divided by speed and into keeping and changing the lane, the
// headings are the course's (positions have no other), and a U-turn needs no eight seconds.

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

// Of each class, in their order.
inline constexpr std::array<std::string_view, 9> kKinematicClassNames = {
    "stationary", "straight_slow", "straight_medium",  "straight_fast",    "left_turn",
    "right_turn", "u_turn",        "lane_change_left", "lane_change_right"};

std::string_view Name(KinematicClass kinematic_class);

// Course at the end less that along +x, radians in (-pi, pi], counter-clockwise. The course at the
// end is the direction of the last metre or more of travel; 0 for one that moves less than a metre.
// For one that sets off backwards it is that of its rear.
//   trajectory: target frame, from the origin along +x
double FinalHeadingChange(const inference::Trajectory& trajectory);

// Whether the first metre of travel goes to the rear.
//   trajectory: target frame
bool SetsOffBackwards(const inference::Trajectory& trajectory);

// How far the end is to the left (positive) of where turning alone leads, metres. With (dx, dy) the
// last waypoint and h = `heading_change`, dy - dx tan(h / 2): an arc's chord points along h / 2.
//   trajectory: target frame
//   heading_change: FinalHeadingChange(trajectory); less than pi
double SidewaysShift(const inference::Trajectory& trajectory, double heading_change);

// With (dx, dy) the last waypoint and h the final heading change, the first that holds of
//   stationary       |(dx, dy)| < 5 m, and speeds over the first and the last interval < 2 m/s
//   U-turn           |h| >= 120 degrees, or |h| >= 30 degrees and dx < -5 m
//   left, right turn |h| >= 30 degrees, by the sign of h
//   lane change      |SidewaysShift| >= 2 m; by its sign
//   straight         by the mean speed along the path: slow, from 5 m/s medium, from 10 m/s fast
// A pedestrian would nearly always be stationary or slow by these. Of pedestrians the thresholds
// are 1.5 m and 0.5 m/s (stationary), -1.5 m (U-turn), 1 m (a step aside in place of the lane
// change), 1 and 2 m/s (stroll, walk, run). Everybody else has those of vehicles.
//
// No threshold depends on the horizon: over 3 s few lane changes are complete, and a slow vehicle
// may count as stationary.
//   waypoint_times: [T] seconds
//   type: of the agent that moves so
KinematicClass Classify(const inference::Trajectory& trajectory,
                        std::span<const double> waypoint_times,
                        v1::AgentType type = v1::AGENT_TYPE_VEHICLE);

// Smallest |h| of a turn, radians: 30 degrees.
inline constexpr double kTurnHeadingChange = 0.523599;

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_KINEMATIC_CLASSES_H_
