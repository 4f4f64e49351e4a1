// How the target has been moving, which the networks may be told beside the raster: a pixel is too
// coarse a ruler for a speed.

#ifndef MANEUVER_MODEL_SCENE_TARGET_MOTION_H_
#define MANEUVER_MODEL_SCENE_TARGET_MOTION_H_

#include <array>

#include "maneuver/v1/scenario.pb.h"

namespace maneuver::scene {

// In units that make each of them about 1:
//   0  speed along the heading now, 10 m/s (negative: backwards)
//   1  its change over the last half second, m/s
//   2  its change over the half second before that, m/s
//   3  change of the heading over the last half second, half radians, counter-clockwise
// Each within -4 .. 4. A change is 0 where no state lies within kMotionTolerance of its ends.
inline constexpr int kMotionInputs = 4;
using MotionInputs = std::array<float, kMotionInputs>;

inline constexpr double kMotionTolerance = 0.15;  // seconds

// Of an agent that has a state at `time` (within kSameTime). Nothing later is looked at.
MotionInputs DescribeMotion(const v1::Agent& agent, double time);

// The same motion in a world `scale` times as large.
MotionInputs Scaled(const MotionInputs& motion, double scale);
// The same motion seen in a mirror along the heading: left and right swap.
MotionInputs Mirrored(const MotionInputs& motion);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_TARGET_MOTION_H_
