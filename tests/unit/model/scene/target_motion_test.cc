#include "model/scene/target_motion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace maneuver::scene::target_motion_test {
namespace {

void AddState(v1::Agent* agent, double time, double heading, double speed) {
  v1::AgentState& state = *agent->add_states();
  state.set_time(time);
  state.set_heading(static_cast<float>(heading));
  state.set_velocity_x(static_cast<float>(speed * std::cos(heading)));
  state.set_velocity_y(static_cast<float>(speed * std::sin(heading)));
}

// Brakes from 12 m/s over 11 to 9 m/s and turns by 0.1 rad in the last half second.
v1::Agent Braking() {
  v1::Agent agent;
  AddState(&agent, 1.0, 0.8, 12.0);
  AddState(&agent, 1.5, 0.8, 11.0);
  AddState(&agent, 2.0, 0.9, 9.0);
  AddState(&agent, 2.5, 2.0, 1.0);
  return agent;
}

TEST(TargetMotionTest, DescribesSpeedItsChangesAndTheTurn) {
  const MotionInputs motion = DescribeMotion(Braking(), 2.0);
  EXPECT_NEAR(motion[0], 0.9, 1e-5);
  EXPECT_NEAR(motion[1], -2.0, 1e-5);
  EXPECT_NEAR(motion[2], -1.0, 1e-5);
  EXPECT_NEAR(motion[3], 0.2, 1e-5);
}

TEST(TargetMotionTest, ReadsNothingLater) {
  v1::Agent cut = Braking();
  cut.mutable_states()->RemoveLast();
  EXPECT_EQ(DescribeMotion(cut, 2.0), DescribeMotion(Braking(), 2.0));
}

TEST(TargetMotionTest, AShortTrackHasOnlyASpeed) {
  v1::Agent agent;
  AddState(&agent, 1.8, 0.3, 6.0);
  AddState(&agent, 2.0, 0.3, 6.5);
  const MotionInputs motion = DescribeMotion(agent, 2.0);
  EXPECT_NEAR(motion[0], 0.65, 1e-5);
  EXPECT_EQ(motion[1], 0.0f);
  EXPECT_EQ(motion[2], 0.0f);
  EXPECT_EQ(motion[3], 0.0f);
}

TEST(TargetMotionTest, ReversingHasANegativeSpeed) {
  v1::Agent agent;
  AddState(&agent, 2.0, 0.3, -3.0);
  EXPECT_NEAR(DescribeMotion(agent, 2.0)[0], -0.3, 1e-5);
}

TEST(TargetMotionTest, ATurnAcrossPiIsSmall) {
  v1::Agent agent;
  AddState(&agent, 1.5, 3.1, 5.0);
  AddState(&agent, 2.0, -3.1, 5.0);
  EXPECT_NEAR(DescribeMotion(agent, 2.0)[3], 2.0 * (2.0 * M_PI - 6.2), 1e-5);
}

TEST(TargetMotionTest, ClampsOutliers) {
  v1::Agent agent;
  AddState(&agent, 1.5, 0.0, -50.0);
  AddState(&agent, 2.0, 0.0, 90.0);
  const MotionInputs motion = DescribeMotion(agent, 2.0);
  EXPECT_EQ(motion[0], 4.0f);
  EXPECT_EQ(motion[1], 4.0f);
}

TEST(TargetMotionTest, TheLargestHeadingsDifferByAFiniteTurn) {
  constexpr float kLargest = std::numeric_limits<float>::max();
  v1::Agent agent;
  AddState(&agent, 1.5, -kLargest, 5.0);
  AddState(&agent, 2.0, kLargest, 5.0);
  EXPECT_TRUE(std::isfinite(DescribeMotion(agent, 2.0)[3]));
}

}  // namespace
}  // namespace maneuver::scene::target_motion_test
