// What one action does, in words.

#ifndef MANEUVER_MODEL_EVALUATION_ACTION_PHRASE_H_
#define MANEUVER_MODEL_EVALUATION_ACTION_PHRASE_H_

#include <string>

#include "maneuver/v1/evaluation.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/inference/trajectory_set.h"

namespace maneuver::evaluation {

// Words, and a number for when two actions have the same words.
struct ActionPhrase {
  std::string words;           // "left turn, tight"
  std::string before = "";     // text before the number: ", "
  double number = 0.0;         // 18.2
  std::string after = "";      // text after it: " m"
  bool with_sign = false;      // "+3"
  bool always_number = false;  // the words alone say too little: "stop"

  // "left turn, tight, 18 m".
  std::string WithNumber(int decimals) const;
};

// What is known of one action.
struct ActionEvidence {
  // Generic mean trajectory, target frame, metres; at least one waypoint. [T, 2]
  inference::Trajectory mean;
  double waypoint_interval = 0.0;  // seconds
  // The type of the predicted agents. Pedestrians have lower limits, as stated below.
  v1::AgentType type = v1::AGENT_TYPE_VEHICLE;
  // Classes of the examples given to the action. Fewer than kTellingExamples say nothing.
  v1::ActionUse use = {};
};

inline constexpr int kTellingExamples = 10;
// If this share of an action's examples turns, it is a turn even if its mean alone leaves that
// open.
inline constexpr double kTellingShare = 0.6;

// Describes an action of a model in metres: the place that its mean leads to. All distances and
// speeds are the mean's; h is FinalHeadingChange and d SidewaysShift (kinematic_classes.h). The
// first that holds:
//
//   stand still          stays within 2 m of the origin
//   reverse              the first metre of travel goes to the rear
//   U-turn left          |h| >= 120 degrees
//   left turn            |h| >= 30 degrees, or >= 12 and the examples are turns; ", tight" if the
//                        turn's radius is less than 12 m, ", wide" if more than 35 m
//   lane change left     |h| < 15 degrees, |d| >= 2 m, and the mean ends as far to the same side;
//                        or |h| < 20 degrees, |d| >= 1 m and at least half of the examples are
//                        lane changes to the left
//   bear left            |h| >= 12 degrees
//   drift left           |d| >= 1 m, and the mean ends as far to the same side
//   stop within 12 m     begins at 1.5 m/s or more and ends below 1 m/s
//   creep forward        begins below 1.5 m/s and ends below 2 m/s
//   start off            begins below 1.5 m/s
//   speed up, slow down  by more than 1.5 m/s and a fifth of the speed at the beginning
//   keep straight        all others
//
// The speeds at the beginning and at the end are over half a second. Left may be right. Pedestrians
// have half of each distance and speed, and "step aside left" in place of a lane change.
// The number is, after "left" or "right", how far to the side the mean ends; after "stop within",
// its largest distance from the origin; after "speed up" and "slow down", the speed at the end;
// after "keep straight", the mean speed; else the length of the path.
ActionPhrase PlacePhrase(const ActionEvidence& evidence);

// Describes an action of a model whose trajectories are relative to the present motion. `mean` is
// that of a target that drives straight on at inference::kActionSetSpeed. The deviation e(t) from
// straight on is what the action does, at any speed. T is the horizon, w = |e_y(T)| (5 s / T)^2,
// and a = g 5 s / T, where g is the speed along x in the last second less kActionSetSpeed:
//
//   left turn            w >= 4.5 m and at least kTellingShare of the examples turn left; or w >=
//                        9.5 m and no other class is more frequent among the examples, or there are
//                        too few examples to tell. ", tight" where the course over the last
//                        second, times 5 s / T, is 40 degrees or more off straight on, ", wide"
//                        below 15 degrees
//   lane change left     1.2 m <= w <= 7.5 m and at least half of the examples are lane changes to
//                        the left
//   bear left            w >= 4.5 m
//   drift left           w >= 1.2 m
//
// These four may end in ", braking" (a' <= -4 m/s), ", slowing" (a' <= -1.5 m/s) or ", speeding up"
// (a' >= 1.5 m/s), where a' is twice the gain in mean speed along the path, times 5 s / T. Else,
// by a in m/s: keep speed (|a| < 0.25), slow down gently and speed up gently (< 1.5), slow down and
// speed up (< 3.5), brake (< 5), brake hard and speed up hard.
//
// Courses are those at kActionSetSpeed. Pedestrians walk at 1.4 m/s instead, have a quarter of each
// distance and speed, and "slow down hard" where vehicles brake or brake hard. The number is
// |e_y(T)| in metres for the first four, and g in m/s for the others.
ActionPhrase RelativePhrase(const ActionEvidence& evidence);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ACTION_PHRASE_H_
