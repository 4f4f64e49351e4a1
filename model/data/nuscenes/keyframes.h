// Fills the time between keyframes.
//
// nuScenes annotates two frames a second; models see ten. Between two keyframes of a track the
// position runs straight at constant speed, and the heading turns evenly along the shorter arc. The
// velocity is the difference of the two positions divided by the time between them. A state between
// two keyframes therefore contains information from the later one, up to half a second ahead.
// real_keyframes_test.cc measures what that costs on tracks of Waymo Open Motion, thinned to 2 Hz:
// the velocity is wrong by 0.2 m/s (root mean square), the position by 3 cm, the heading by
// 0.004 rad.

#ifndef MANEUVER_MODEL_DATA_NUSCENES_KEYFRAMES_H_
#define MANEUVER_MODEL_DATA_NUSCENES_KEYFRAMES_H_

#include <span>

#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

// Seconds between frames. Frames lie at multiples of this on the scenario's clock.
inline constexpr double kFrameInterval = 0.1;
// If two keyframes are further apart, nothing is filled in between them. Seconds.
inline constexpr double kMaxKeyframeGap = 0.75;

struct Keyframe {
  double time = 0.0;     // seconds
  double x = 0.0;        // metres
  double y = 0.0;        // metres
  float heading = 0.0F;  // radians
};

// Appends to `agent` a state at each frame between two keyframes that are at most kMaxKeyframeGap
// apart. Appends none before the first keyframe, after the last one, or at a keyframe between two
// gaps, where the velocity is unknown. A frame at a keyframe has the velocity of the interval that
// ends there.
//   keyframes: in strictly increasing time
void AddFrames(std::span<const Keyframe> keyframes, v1::Agent* agent);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_NUSCENES_KEYFRAMES_H_
