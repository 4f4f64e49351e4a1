#include "model/scene/target_motion.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "model/scene/target_frame.h"

namespace maneuver::scene {
namespace {

constexpr double kSpeedUnit = 10.0;  // m/s
constexpr double kTurnUnit = 0.5;    // radians
constexpr double kStep = 0.5;        // seconds
constexpr double kLargest = 4.0;

double SpeedAlongHeading(const v1::AgentState& state) {
  return state.velocity_x() * std::cos(state.heading()) +
         state.velocity_y() * std::sin(state.heading());
}

float Limited(double value) { return static_cast<float>(std::clamp(value, -kLargest, kLargest)); }

}  // namespace

MotionInputs DescribeMotion(const v1::Agent& agent, double time) {
  const auto state_at = [&](double t) -> const v1::AgentState* {
    const int index = FindState(agent, t, kMotionTolerance, time + kSameTime);
    return index < 0 ? nullptr : &agent.states(index);
  };
  MotionInputs motion{};
  const v1::AgentState* now = state_at(time);
  if (now == nullptr) return motion;
  motion[0] = Limited(SpeedAlongHeading(*now) / kSpeedUnit);
  const v1::AgentState* before = state_at(time - kStep);
  if (before == nullptr) return motion;
  motion[1] = Limited(SpeedAlongHeading(*now) - SpeedAlongHeading(*before));
  // In double: the difference of two floats may overflow a float.
  const double turn = double{now->heading()} - double{before->heading()};
  motion[3] = Limited(std::remainder(turn, 2.0 * std::numbers::pi) / kTurnUnit);
  const v1::AgentState* earlier = state_at(time - 2.0 * kStep);
  if (earlier == nullptr) return motion;
  motion[2] = Limited(SpeedAlongHeading(*before) - SpeedAlongHeading(*earlier));
  return motion;
}

MotionInputs Scaled(const MotionInputs& motion, double scale) {
  MotionInputs scaled = motion;
  for (const size_t i : {0, 1, 2}) scaled[i] = Limited(scale * motion[i]);
  return scaled;
}

MotionInputs Mirrored(const MotionInputs& motion) {
  MotionInputs mirrored = motion;
  mirrored[3] = -motion[3];
  return mirrored;
}

}  // namespace maneuver::scene
