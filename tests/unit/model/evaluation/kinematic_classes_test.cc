#include "model/evaluation/kinematic_classes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "tests/unit/model/evaluation/driven_trajectory.h"

namespace maneuver::evaluation::kinematic_classes_test {
namespace {

using inference::Trajectory;

constexpr double kDegree = std::numbers::pi / 180.0;

// Returns an arc of `length` metres that turns by `turn` radians.
Trajectory Arc(double length, double turn) {
  return Driven([=](double t) {
    const double angle = turn * t / 5.0;
    const double radius = length / turn;
    return Eigen::RowVector2d(radius * std::sin(angle), radius * (1.0 - std::cos(angle)));
  });
}

Trajectory Straight(double speed) {
  return Driven([=](double t) { return Eigen::RowVector2d(speed * t, 0.0); });
}

// Returns a path `length` metres ahead and `shift` to the left, whose final heading is the initial
// one.
Trajectory Shifted(double length, double shift) {
  return Driven([=](double t) {
    const double share = 0.5 * (1.0 - std::cos(std::numbers::pi * std::min(1.0, t / 4.0)));
    return Eigen::RowVector2d(length * t / 5.0, shift * share);
  });
}

std::string ClassOf(const Trajectory& trajectory) {
  return std::string(Name(Classify(trajectory, Times())));
}

TEST(KinematicClassesTest, PedestriansHaveThresholdsOfTheirOwn) {
  const auto class_of = [](const Trajectory& trajectory, v1::AgentType type) {
    return std::string(Name(Classify(trajectory, Times(), type)));
  };
  const auto on_foot = [&](const Trajectory& trajectory) {
    return class_of(trajectory, v1::AGENT_TYPE_PEDESTRIAN);
  };
  EXPECT_EQ(ClassOf(Straight(0.9)), "stationary");
  EXPECT_EQ(class_of(Straight(0.9), v1::AGENT_TYPE_CYCLIST), "stationary");
  EXPECT_EQ(on_foot(Straight(0.2)), "stationary");
  EXPECT_EQ(on_foot(Straight(0.9)), "straight_slow");
  EXPECT_EQ(on_foot(Straight(1.4)), "straight_medium");
  EXPECT_EQ(on_foot(Straight(3.0)), "straight_fast");
  EXPECT_EQ(on_foot(Shifted(12.0, 1.1)), "lane_change_left");
  EXPECT_EQ(on_foot(Shifted(12.0, -0.9)), "straight_fast");
  EXPECT_EQ(ClassOf(Shifted(12.0, 1.1)), "straight_slow");
}

TEST(KinematicClassesTest, StraightDrivingIsDividedBySpeed) {
  EXPECT_EQ(ClassOf(Straight(4.9)), "straight_slow");
  EXPECT_EQ(ClassOf(Straight(5.1)), "straight_medium");
  EXPECT_EQ(ClassOf(Straight(9.9)), "straight_medium");
  EXPECT_EQ(ClassOf(Straight(10.1)), "straight_fast");
}

TEST(KinematicClassesTest, StationaryMeansNearAndSlowAtBothEnds) {
  EXPECT_EQ(ClassOf(Straight(0.0)), "stationary");
  EXPECT_EQ(ClassOf(Straight(0.9)), "stationary");
  EXPECT_EQ(ClassOf(Straight(1.1)), "straight_slow");  // 5.5 m
  // 4.5 m, but it starts at 5 m/s.
  EXPECT_EQ(
      ClassOf(Driven([](double t) { return Eigen::RowVector2d(5.0 * std::min(t, 0.9), 0.0); })),
      "straight_slow");
}

TEST(KinematicClassesTest, TurnsBeginAtThirtyDegrees) {
  EXPECT_EQ(ClassOf(Arc(40.0, 80.0 * kDegree)), "left_turn");
  EXPECT_EQ(ClassOf(Arc(40.0, -80.0 * kDegree)), "right_turn");
  EXPECT_EQ(ClassOf(Arc(40.0, 33.0 * kDegree)), "left_turn");
  EXPECT_EQ(ClassOf(Arc(40.0, 27.0 * kDegree)), "straight_medium");
}

TEST(KinematicClassesTest, UTurnsTurnAroundOrEndBehind) {
  EXPECT_EQ(ClassOf(Arc(25.0, 175.0 * kDegree)), "u_turn");
  EXPECT_EQ(ClassOf(Arc(25.0, -175.0 * kDegree)), "u_turn");
  EXPECT_EQ(ClassOf(Arc(25.0, 115.0 * kDegree)), "left_turn");
}

TEST(KinematicClassesTest, LaneChangesKeepTheHeading) {
  EXPECT_EQ(ClassOf(Shifted(50.0, 3.5)), "lane_change_left");
  EXPECT_EQ(ClassOf(Shifted(50.0, -3.5)), "lane_change_right");
  EXPECT_EQ(ClassOf(Shifted(50.0, 1.5)), "straight_fast");
}

// A road that bends by 20 degrees leads a vehicle 8.7 m to the left without a lane change.
TEST(KinematicClassesTest, FollowingABendIsNotALaneChange) {
  const Trajectory bend = Arc(50.0, 20.0 * kDegree);
  EXPECT_GT(bend(49, 1), 8.0);
  EXPECT_EQ(ClassOf(bend), "straight_medium");
}

TEST(KinematicClassesTest, TurningAloneIsNotAShift) {
  for (const double turn : {-100.0, 20.0, 80.0}) {
    EXPECT_NEAR(SidewaysShift(Arc(50.0, turn * kDegree), turn * kDegree), 0.0, 1e-9);
  }
  EXPECT_NEAR(SidewaysShift(Shifted(50.0, 3.5), 0.0), 3.5, 1e-12);
  EXPECT_NEAR(SidewaysShift(Shifted(50.0, -3.5), 0.0), -3.5, 1e-12);
}

TEST(KinematicClassesTest, BackingOutIsNotAUTurn) {
  EXPECT_EQ(ClassOf(Straight(-2.0)), "straight_slow");
  EXPECT_NEAR(FinalHeadingChange(Straight(-2.0)), 0.0, 1e-12);
}

TEST(KinematicClassesTest, TheHeadingChangeRemainsAfterStopping) {
  // A left turn by 60 degrees that ends after three seconds; then it creeps by centimetres.
  const Trajectory turn = Driven([](double t) {
    const double angle = 60.0 * kDegree * std::min(1.0, t / 3.0);
    const double creep = t > 3.0 ? 0.001 * (t - 3.0) : 0.0;
    return Eigen::RowVector2d(15.0 * std::sin(angle) + creep, 15.0 * (1.0 - std::cos(angle)));
  });
  EXPECT_NEAR(FinalHeadingChange(turn), 60.0 * kDegree, 4.0 * kDegree);
  EXPECT_NEAR(FinalHeadingChange(Arc(40.0, -80.0 * kDegree)), -80.0 * kDegree, 2.0 * kDegree);
  EXPECT_EQ(FinalHeadingChange(Straight(0.1)), 0.0);
}

}  // namespace
}  // namespace maneuver::evaluation::kinematic_classes_test
