#include "model/scene/target_frame.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/model/scene/scene_fixture.h"

namespace maneuver::scene::target_frame_test {
namespace {

constexpr double kTolerance = 0.05;

v1::Agent AgentAt(std::initializer_list<double> times) {
  v1::Agent agent;
  for (const double time : times) AddState(&agent, time, 10.0 * time, 0.0, 0.0);
  return agent;
}

TEST(FindAgentTest, FindsById) {
  v1::Scenario scenario;
  AddAgent(&scenario, 7, v1::AGENT_TYPE_VEHICLE, 4, 2);
  AddAgent(&scenario, -3, v1::AGENT_TYPE_VEHICLE, 5, 2);
  EXPECT_EQ(FindAgent(scenario, -3), &scenario.agents(1));
  EXPECT_EQ(FindAgent(scenario, 8), nullptr);
}

TEST(FindStateTest, TakesTheNearestWithinTolerance) {
  const v1::Agent agent = AgentAt({0.0, 0.1, 0.2, 0.5});
  EXPECT_EQ(FindState(agent, 0.1, kTolerance, 1.0), 1);
  EXPECT_EQ(FindState(agent, 0.14, kTolerance, 1.0), 1);
  EXPECT_EQ(FindState(agent, 0.16, kTolerance, 1.0), 2);
  EXPECT_EQ(FindState(agent, 0.24, kTolerance, 1.0), 2);
  EXPECT_EQ(FindState(agent, 0.3, kTolerance, 1.0), -1);
  EXPECT_EQ(FindState(agent, 0.3, HUGE_VAL, 1.0), 2);
  EXPECT_EQ(FindState(agent, -0.2, kTolerance, 1.0), -1);
  EXPECT_EQ(FindState(agent, 0.56, kTolerance, 1.0), -1);
  EXPECT_EQ(FindState(v1::Agent(), 0.0, HUGE_VAL, 1.0), -1);
}

TEST(FindStateTest, ToleranceIncludesItsEndDespiteRounding) {
  EXPECT_EQ(FindState(AgentAt({0.1 + 0.2}), 0.35, 0.05, 1.0), 0);
}

TEST(FindStateTest, NeverTakesALaterStateThanAllowed) {
  const v1::Agent agent = AgentAt({0.0, 0.1, 0.2});
  EXPECT_EQ(FindState(agent, 0.19, 1.0, 0.19), 1);
  EXPECT_EQ(FindState(agent, 0.19, kTolerance, 0.19), -1);
  EXPECT_EQ(FindState(agent, 0.19, kTolerance, 0.2), 2);
  EXPECT_EQ(FindState(agent, 0.0, 1.0, -0.1), -1);
}

TEST(TargetPoseTest, ReturnsThePoseOfTheStateNow) {
  v1::Agent agent;
  AddState(&agent, 0.9, 1, 2, 0.1);
  AddState(&agent, 1.0 + 1e-7, 3, 4, 0.2);  // now, but for rounding
  AddState(&agent, 1.02, 5, 6, 0.3);        // later
  const auto pose = TargetPose(agent, 1.0, kTolerance);
  ASSERT_TRUE(pose.has_value());
  EXPECT_EQ(pose->x(), 3);
  EXPECT_EQ(pose->y(), 4);
  EXPECT_EQ(pose->heading(), 0.2F);
}

TEST(TargetPoseTest, AnAgentGoesOnFromAStateThatIsALittleOld) {
  v1::Agent agent;
  AddState(&agent, 0.9, 1, 2, 0.1);
  agent.mutable_states(0)->set_velocity_x(30.0F);
  agent.mutable_states(0)->set_velocity_y(-10.0F);
  const auto pose = TargetPose(agent, 1.0, 0.125);
  ASSERT_TRUE(pose.has_value());
  EXPECT_NEAR(pose->x(), 4.0, 1e-9);
  EXPECT_NEAR(pose->y(), 1.0, 1e-9);
  EXPECT_EQ(pose->heading(), 0.1F);
  const auto before = TargetPose(agent, 1.0, 0.125, /*inputs_version=*/2);
  ASSERT_TRUE(before.has_value());
  EXPECT_EQ(before->x(), 1);
  EXPECT_EQ(before->y(), 2);
}

TEST(TargetPoseTest, ReturnsNothingWithoutARecentState) {
  EXPECT_FALSE(TargetPose(AgentAt({0.8, 1.02}), 1.0, kTolerance).has_value());
  EXPECT_TRUE(TargetPose(AgentAt({0.96}), 1.0, kTolerance).has_value());
}

TEST(Pose2Test, MapsPointsBetweenFramesAndBack) {
  const Pose2 X_WT(10, 20, M_PI / 2);
  const Point2 p_W = X_WT * Point2{3, 1};  // 3 ahead is +y, 1 to the left is -x
  EXPECT_NEAR(p_W.x, 9, 1e-12);
  EXPECT_NEAR(p_W.y, 23, 1e-12);
  const Point2 p_T = X_WT.ToLocal(p_W);
  EXPECT_NEAR(p_T.x, 3, 1e-12);
  EXPECT_NEAR(p_T.y, 1, 1e-12);
}

}  // namespace
}  // namespace maneuver::scene::target_frame_test
