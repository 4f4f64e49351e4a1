// Predictors that learn nothing: what a model must beat.

#ifndef MANEUVER_MODEL_EVALUATION_BASELINES_H_
#define MANEUVER_MODEL_EVALUATION_BASELINES_H_

#include <span>

#include "maneuver/v1/scenario.pb.h"
#include "model/inference/action_model.h"
#include "model/scene/pose2.h"

namespace maneuver::evaluation {

using inference::Trajectory;

// How a vehicle moves at one time, in its own frame there (+x along its heading, +y to its left).
struct Motion {
  double velocity_x = 0.0;    // m/s
  double velocity_y = 0.0;    // m/s
  double acceleration = 0.0;  // m/s^2, of the speed along the heading
  double turn_rate = 0.0;     // rad/s, counter-clockwise

  double speed() const;  // m/s, >= 0
};

// The motion at `time`, at which `agent` has a state. The velocity is that state's; acceleration
// and turn rate are the least-squares slopes of the recorded speed along the heading and of the
// heading (unwrapped) over the states of the past second, 0 if there is but one. States after
// `time` are not looked at.
Motion EstimateMotion(const v1::Agent& agent, double time);

// Constant velocity: p(t) = v t.
//   waypoint_times: [T] seconds
Trajectory ConstantVelocity(const Motion& motion, std::span<const double> waypoint_times);

// Constant turn rate and acceleration (CTRA): the position p(t) with
//   dp/dt = (v + a t) (cos w t, sin w t),  v the velocity along the heading,
// until the speed reaches 0: one that brakes stops and does not drive back.
//   waypoint_times: [T] seconds
Trajectory ConstantTurnRateAndAcceleration(const Motion& motion,
                                           std::span<const double> waypoint_times);

// The faded roll-out: acceleration and turn rate, shrunk by the noise of their estimates, fade away
// within about a second (scene::RollOut, FADING_MOTION; scene::EstimateMotion). What models with
// that reference start from.
//   agent: has a state at `time`; later states are not looked at
//   X_WT: pose of the agent at `time` in the world
//   waypoint_times: [T] seconds
Trajectory FadedRollOut(const v1::Agent& agent, double time, const scene::Pose2& X_WT,
                        std::span<const double> waypoint_times);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_BASELINES_H_
