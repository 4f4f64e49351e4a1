// The target's recent motion, an input of some networks beside the raster: speeds cannot be read
// precisely from pixels.

#ifndef MANEUVER_MODEL_SCENE_TARGET_MOTION_H_
#define MANEUVER_MODEL_SCENE_TARGET_MOTION_H_

#include <array>

#include "maneuver/v1/scenario.pb.h"

namespace maneuver::scene {

// In units that make each number about 1:
//   0  speed along the heading now, 10 m/s (negative: backwards)
//   1  change of that speed over the last half second, m/s
//   2  change of that speed over the half second before that, m/s
//   3  change of the heading over the last half second, half radians, counter-clockwise
// Each is clamped to -4 .. 4. A change is 0 if no state lies within kMotionTolerance of one of its
// ends.
inline constexpr int kMotionInputs = 4;
using MotionInputs = std::array<float, kMotionInputs>;

inline constexpr double kMotionTolerance = 0.15;  // seconds

// Describes an agent that has a state at `time` (within kSameTime). Reads nothing later.
MotionInputs DescribeMotion(const v1::Agent& agent, double time);

// Returns the same motion in a world `scale` times as large.
MotionInputs Scaled(const MotionInputs& motion, double scale);
// Returns the same motion mirrored along the heading: left and right swap.
MotionInputs Mirrored(const MotionInputs& motion);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_TARGET_MOTION_H_
