// Predictors that learn nothing. A model must do better than they do.

#ifndef MANEUVER_MODEL_EVALUATION_BASELINES_H_
#define MANEUVER_MODEL_EVALUATION_BASELINES_H_

#include <span>

#include "maneuver/v1/scenario.pb.h"
#include "model/inference/action_model.h"
#include "model/scene/pose2.h"

namespace maneuver::evaluation {

using inference::Trajectory;

// A vehicle's motion at one time, in its own frame then (+x along its heading, +y to its left).
struct Motion {
  double velocity_x = 0.0;    // m/s
  double velocity_y = 0.0;    // m/s
  double acceleration = 0.0;  // m/s^2, of the speed along the heading
  double turn_rate = 0.0;     // rad/s, counter-clockwise

  double speed() const;  // m/s, >= 0
};

// Estimates the motion at `time`, at which `agent` must have a state. The velocity is that state's.
// Acceleration and turn rate are the least-squares slopes of the recorded speed along the heading
// and of the heading (unwrapped) over the states of the past second; 0 if there is only one.
// Ignores states after `time`.
Motion MotionAt(const v1::Agent& agent, double time);

// Returns the trajectory at constant velocity, p(t) = v t.
//   waypoint_times: [T] seconds
Trajectory ConstantVelocity(const Motion& motion, std::span<const double> waypoint_times);

// Returns the trajectory at constant turn rate and acceleration (CTRA): the position p(t) with
//   dp/dt = (v + a t) (cos w t, sin w t), where v is the velocity along the heading,
// until the speed reaches 0: a braking vehicle stops and does not reverse. One that has just
// stopped stays.
//   waypoint_times: [T] seconds
Trajectory ConstantTurnRateAndAcceleration(const Motion& motion,
                                           std::span<const double> waypoint_times);

// Returns the faded roll-out (scene::RollOut, FADING_MOTION; scene::EstimateMotion): acceleration
// and turn rate, shrunk by the noise of their estimates, fade within about a second. Models with
// this reference predict relative to it if they have version 2 of the inputs
// (scene/inputs_version.h).
//   agent: must have a state at `time`; later states are ignored.
//   X_WT: pose of the agent at `time` in the world.
//   waypoint_times: [T] seconds.
Trajectory FadedRollOut(const v1::Agent& agent, double time, const scene::Pose2& X_WT,
                        std::span<const double> waypoint_times);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_BASELINES_H_
