// The trajectory reference r(m): the target's present motion, rolled out. Trajectories are measured
// from it.

#ifndef MANEUVER_MODEL_SCENE_MOTION_REFERENCE_H_
#define MANEUVER_MODEL_SCENE_MOTION_REFERENCE_H_

#include <span>

#include "maneuver/v1/model_spec.pb.h"
#include "model/scene/target_history.h"

namespace maneuver::scene {

// Time constant after which the present acceleration and turn rate say little about what follows,
// seconds.
inline constexpr double kMotionFades = 1.0;
inline constexpr double kMostAcceleration = 4.0;  // m/s^2, either sign
inline constexpr double kMostTurnRate = 1.0;      // rad/s, either sign

// Writes r(t) at each waypoint time, x then y, target frame, metres.
//
//   NONE               r = 0
//   CONSTANT_VELOCITY  r = (v0 t, 0), v0 the speed along the heading
//   FADING_MOTION      acceleration a0 and turn rate w0 decay as e^(-t / tau), tau = kMotionFades:
//
//     f(t) = tau (1 - e^(-t / tau))
//     v(t) = v0 + a0 f(t), not below min(v0, 0)           a0 clamped to +- kMostAcceleration
//     h(t) = w0 f(t)                                      w0 clamped to +- kMostTurnRate
//     r(t) = integral of v (cos h, sin h) from 0 to t
//
//   A vehicle that brakes stops. One that has just stopped stays, although its past second still
//   shows the braking, and one that backs does not back faster. With version 1 of the inputs
//   (inputs_version.h), v(t) has no such bound where v0 <= 0: these two are driven backwards.
//
//   The integral is by the midpoint rule. Each interval between waypoints is divided into equal
//   steps of at most 0.1 s; v and h of a step are the means of their values at its two ends.
//
//   waypoint_times: [T] seconds, increasing, above 0
//   reference: [T, 2]
void RollOut(v1::TrajectoryReference kind, int inputs_version, const MotionEstimate& motion,
             std::span<const double> waypoint_times, std::span<double> reference);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_MOTION_REFERENCE_H_
