#include "model/data/trajectory.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace maneuver::data::trajectory_test {
namespace {

constexpr double kMaxGap = 0.25;

v1::AgentState State(double time, double x, double y) {
  v1::AgentState state;
  state.set_time(time);
  state.set_x(x);
  state.set_y(y);
  return state;
}

// Returns the position on a circle of radius 20 m about the origin at 10 m/s, counter-clockwise
// from (20, 0).
scene::Point2 OnCircle(double time) {
  const double angle = 0.5 * time;
  return {20.0 * std::cos(angle), 20.0 * std::sin(angle)};
}

v1::Agent CircleAgent(int states, double interval) {
  v1::Agent agent;
  for (int i = 0; i < states; ++i) {
    const double time = interval * i;
    *agent.add_states() = State(time, OnCircle(time).x, OnCircle(time).y);
  }
  return agent;
}

TEST(ResampleFutureTest, FollowsAnAnalyticCurveInTheTargetsFrame) {
  const v1::Agent agent = CircleAgent(101, 0.1);
  // At t = 2 the body lies at angle 1 and heads along the tangent.
  const double time = 2.0;
  const scene::Pose2 X_WT(OnCircle(time).x, OnCircle(time).y, 1.0 + std::numbers::pi / 2.0);
  // Between states and on them.
  const std::vector<double> waypoint_times = {0.1, 0.25, 1.0, 3.33, 8.0};
  std::vector<double> trajectory(2 * waypoint_times.size());
  ASSERT_TRUE(ResampleFuture(agent, time, X_WT, waypoint_times, kMaxGap, trajectory));
  // A chord of 0.1 s departs from the arc by at most v^2 dt^2 / (8 r) = 6.25 mm.
  constexpr double kSagitta = 100.0 * 0.01 / (8.0 * 20.0) + 1e-9;
  for (size_t i = 0; i < waypoint_times.size(); ++i) {
    const double turned = 0.5 * waypoint_times[i];
    // From the tangent, to the left: x = r sin, y = r (1 - cos).
    EXPECT_NEAR(trajectory[2 * i], 20.0 * std::sin(turned), kSagitta) << i;
    EXPECT_NEAR(trajectory[2 * i + 1], 20.0 * (1.0 - std::cos(turned)), kSagitta) << i;
  }
}

TEST(ResampleFutureTest, IsExactOnStates) {
  const v1::Agent agent = CircleAgent(101, 0.1);
  const std::vector<double> waypoint_times = {agent.states(50).time()};
  std::vector<double> trajectory(2);
  ASSERT_TRUE(ResampleFuture(agent, 0.0, scene::Pose2(), waypoint_times, kMaxGap, trajectory));
  EXPECT_DOUBLE_EQ(trajectory[0], agent.states(50).x());
  EXPECT_DOUBLE_EQ(trajectory[1], agent.states(50).y());
}

TEST(ResampleFutureTest, InterpolatesByTimeWhereStepsAreUneven) {
  v1::Agent agent;
  *agent.add_states() = State(0.0, 0.0, 0.0);
  *agent.add_states() = State(0.05, 1.0, 0.0);
  *agent.add_states() = State(0.25, 5.0, 2.0);
  const std::vector<double> waypoint_times = {0.10};
  std::vector<double> trajectory(2);
  ASSERT_TRUE(ResampleFuture(agent, 0.0, scene::Pose2(), waypoint_times, kMaxGap, trajectory));
  EXPECT_NEAR(trajectory[0], 2.0, 1e-12);
  EXPECT_NEAR(trajectory[1], 0.5, 1e-12);
}

TEST(ResampleFutureTest, RefusesAWaypointAfterTheLastStateAndNamesIt) {
  const v1::Agent agent = CircleAgent(11, 0.1);  // to t = 1
  const std::vector<double> waypoint_times = {0.5, 1.0, 1.1};
  std::vector<double> trajectory(6);
  int missing = -1;
  EXPECT_FALSE(
      ResampleFuture(agent, 0.0, scene::Pose2(), waypoint_times, kMaxGap, trajectory, &missing));
  EXPECT_EQ(missing, 2);
}

TEST(ResampleFutureTest, RefusesAWaypointBeforeTheFirstState) {
  v1::Agent agent;
  *agent.add_states() = State(1.0, 0.0, 0.0);
  *agent.add_states() = State(1.1, 0.0, 0.0);
  const std::vector<double> waypoint_times = {0.5};
  std::vector<double> trajectory(2);
  int missing = -1;
  EXPECT_FALSE(
      ResampleFuture(agent, 0.0, scene::Pose2(), waypoint_times, kMaxGap, trajectory, &missing));
  EXPECT_EQ(missing, 0);
}

TEST(ResampleFutureTest, RefusesAnAgentWithoutStates) {
  const std::vector<double> waypoint_times = {0.5};
  std::vector<double> trajectory(2);
  EXPECT_FALSE(
      ResampleFuture(v1::Agent(), 0.0, scene::Pose2(), waypoint_times, kMaxGap, trajectory));
}

TEST(ResampleFutureTest, AcceptsAClockThatJitters) {
  const v1::Agent agent = CircleAgent(11, 0.1);  // to t = 1
  const std::vector<double> waypoint_times = {1.001};
  std::vector<double> trajectory(2);
  ASSERT_TRUE(ResampleFuture(agent, 0.0, scene::Pose2(), waypoint_times, kMaxGap, trajectory));
  EXPECT_DOUBLE_EQ(trajectory[0], agent.states(10).x());
}

// States at 0, 0.1, 0.2, then 0.5, 0.6.
v1::Agent GappedAgent() {
  v1::Agent agent;
  for (const double time : {0.0, 0.1, 0.2, 0.5, 0.6}) *agent.add_states() = State(time, time, 0.0);
  return agent;
}

TEST(ResampleFutureTest, NeverInventsAWaypointInAGap) {
  const std::vector<double> waypoint_times = {0.1, 0.3};
  std::vector<double> trajectory(4);
  int missing = -1;
  EXPECT_FALSE(ResampleFuture(GappedAgent(), 0.0, scene::Pose2(), waypoint_times, kMaxGap,
                              trajectory, &missing));
  EXPECT_EQ(missing, 1);
}

TEST(ResampleFutureTest, StatesOnTheEdgesOfAGapStillCount) {
  const std::vector<double> waypoint_times = {0.2, 0.5, 0.6};
  std::vector<double> trajectory(6);
  ASSERT_TRUE(
      ResampleFuture(GappedAgent(), 0.0, scene::Pose2(), waypoint_times, kMaxGap, trajectory));
  EXPECT_NEAR(trajectory[0], 0.2, 1e-12);
  EXPECT_NEAR(trajectory[2], 0.5, 1e-12);
}

TEST(ResampleFutureTest, BridgesAGapAsLongAsAllowed) {
  const std::vector<double> waypoint_times = {0.3};
  std::vector<double> trajectory(2);
  ASSERT_TRUE(ResampleFuture(GappedAgent(), 0.0, scene::Pose2(), waypoint_times, 0.3, trajectory));
  EXPECT_NEAR(trajectory[0], 0.3, 1e-12);
}

}  // namespace
}  // namespace maneuver::data::trajectory_test
