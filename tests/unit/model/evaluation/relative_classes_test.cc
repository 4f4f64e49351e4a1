#include "model/evaluation/relative_classes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "tests/unit/model/evaluation/driven_trajectory.h"

namespace maneuver::evaluation::relative_classes_test {
namespace {

using inference::Trajectory;

constexpr double kDegree = std::numbers::pi / 180.0;

// Returns a straight path. Its speed changes evenly from `start` to `end` over four seconds, then
// stays.
Trajectory SpeedChange(double start, double end) {
  return Driven([=](double t) {
    const double changing = std::min(t, 4.0);
    const double way =
        start * changing + (end - start) * changing * changing / 8.0 + end * (t - changing);
    return Eigen::RowVector2d(way, 0.0);
  });
}

// Returns an arc of `length` metres that turns by `turn` radians.
Trajectory Arc(double length, double turn) {
  return Driven([=](double t) {
    const double angle = turn * t / 5.0;
    const double radius = length / turn;
    return Eigen::RowVector2d(radius * std::sin(angle), radius * (1.0 - std::cos(angle)));
  });
}

// Returns a path at 10 m/s that ends `shift` metres to the left with its initial heading.
Trajectory Shifted(double shift) {
  return Driven([=](double t) {
    const double share = 0.5 * (1.0 - std::cos(std::numbers::pi * std::min(1.0, t / 4.0)));
    return Eigen::RowVector2d(10.0 * t, shift * share);
  });
}

std::string ClassOf(const Trajectory& trajectory, double present_speed,
                    v1::AgentType type = v1::AGENT_TYPE_VEHICLE) {
  return std::string(Name(ClassifyRelative(trajectory, Times(), present_speed, type)));
}

std::string ClassOfChange(double start, double end) {
  return ClassOf(SpeedChange(start, end), start);
}

TEST(RelativeClassesTest, StandsIfItStaysWithinTwoMetres) {
  EXPECT_EQ(ClassOfChange(0.0, 0.0), "stands");
  EXPECT_EQ(ClassOfChange(0.39, 0.39), "stands");       // 1.95 m
  EXPECT_EQ(ClassOfChange(0.41, 0.41), "keeps_speed");  // 2.05 m
}

// 10 cm from each waypoint to the next: a path of 5 m without progress.
TEST(RelativeClassesTest, NoiseIsNotMotion) {
  int i = 0;
  const Trajectory jitter =
      Driven([&](double) { return Eigen::RowVector2d(++i % 2 == 0 ? 0.05 : -0.05, 0.0); });
  EXPECT_EQ(ClassOf(jitter, 0.0), "stands");
}

TEST(RelativeClassesTest, StopsIfItMovedAndEndsBelowHalfAMetreASecond) {
  EXPECT_EQ(ClassOfChange(8.0, 0.0), "stops");
  EXPECT_EQ(ClassOfChange(8.0, 0.45), "stops");
  EXPECT_EQ(ClassOfChange(8.0, 0.55), "brakes");
  EXPECT_EQ(
      ClassOf(Driven([](double t) { return Eigen::RowVector2d(std::min(t, 1.5), 0.0); }), 1.0),
      "stops");
}

TEST(RelativeClassesTest, StartsIfItStoodAndEndsAboveAMetreASecond) {
  EXPECT_EQ(ClassOfChange(0.0, 6.0), "starts");
  EXPECT_EQ(ClassOfChange(0.9, 1.1), "starts");
  EXPECT_EQ(ClassOfChange(0.9, 0.95), "keeps_speed");
  EXPECT_EQ(ClassOfChange(1.1, 6.0), "accelerates");
}

TEST(RelativeClassesTest, SpeedChangesCountFromOneMetreASecondOrFifteenPercent) {
  EXPECT_EQ(ClassOfChange(4.0, 4.95), "keeps_speed");
  EXPECT_EQ(ClassOfChange(4.0, 5.05), "accelerates");
  EXPECT_EQ(ClassOfChange(4.0, 3.05), "keeps_speed");
  EXPECT_EQ(ClassOfChange(4.0, 2.95), "brakes");
  EXPECT_EQ(ClassOfChange(20.0, 22.9), "keeps_speed");
  EXPECT_EQ(ClassOfChange(20.0, 23.1), "accelerates");
  EXPECT_EQ(ClassOfChange(20.0, 17.1), "keeps_speed");
  EXPECT_EQ(ClassOfChange(20.0, 16.9), "brakes");
}

TEST(RelativeClassesTest, TurnsOverrideChangesOfSpeed) {
  EXPECT_EQ(ClassOf(Arc(40.0, 35.0 * kDegree), 8.0), "turns_left");
  EXPECT_EQ(ClassOf(Arc(40.0, -35.0 * kDegree), 14.0), "turns_right");
  EXPECT_EQ(ClassOf(Arc(40.0, 27.0 * kDegree), 14.0), "brakes");
  EXPECT_EQ(ClassOf(Arc(40.0, 90.0 * kDegree), 0.0), "turns_left");
}

TEST(RelativeClassesTest, UTurnsBeginAt135Degrees) {
  EXPECT_EQ(ClassOf(Arc(25.0, 145.0 * kDegree), 5.0), "u_turn");
  EXPECT_EQ(ClassOf(Arc(25.0, -145.0 * kDegree), 5.0), "u_turn");
  EXPECT_EQ(ClassOf(Arc(25.0, 130.0 * kDegree), 5.0), "turns_left");
}

// Half a metre to the side and back has a course, but is not a turn.
TEST(RelativeClassesTest, DoesNotTurnIfItHardlyMoves) {
  const Trajectory aside = Driven([](double t) { return Eigen::RowVector2d(0.3, 0.38 * t); });
  EXPECT_EQ(ClassOf(aside, 0.2), "stands");
}

TEST(RelativeClassesTest, LaneChangesAreTwoMetresAcross) {
  EXPECT_EQ(ClassOf(Shifted(2.1), 10.0), "lane_change_left");
  EXPECT_EQ(ClassOf(Shifted(-2.1), 10.0), "lane_change_right");
  EXPECT_EQ(ClassOf(Shifted(1.9), 10.0), "keeps_speed");
  EXPECT_EQ(ClassOf(Shifted(3.5), 15.0), "lane_change_left");
}

// A bend by 14 degrees leads 12 m to the left over 100 m.
TEST(RelativeClassesTest, FollowingABendIsNotALaneChange) {
  const Trajectory bend = Arc(100.0, 14.0 * kDegree);
  EXPECT_GT(bend(49, 1), 12.0);
  EXPECT_EQ(ClassOf(bend, 20.0), "keeps_speed");
}

// 60 m straight ahead, then 20 m at the angle: far from the chord of any arc.
TEST(RelativeClassesTest, LaneChangesEndWithinFifteenDegrees) {
  const auto kinked = [](double angle) {
    return Driven([=](double t) {
      const double after = std::max(0.0, 16.0 * t - 60.0);
      return Eigen::RowVector2d(16.0 * t - after + after * std::cos(angle),
                                after * std::sin(angle));
    });
  };
  EXPECT_EQ(ClassOf(kinked(-14.0 * kDegree), 16.0), "lane_change_left");
  EXPECT_EQ(ClassOf(kinked(-16.0 * kDegree), 16.0), "keeps_speed");
}

TEST(RelativeClassesTest, PedestriansHaveHalfOfEachThreshold) {
  const auto on_foot = [](double start, double end) {
    return ClassOf(SpeedChange(start, end), start, v1::AGENT_TYPE_PEDESTRIAN);
  };
  EXPECT_EQ(on_foot(0.19, 0.19), "stands");
  EXPECT_EQ(on_foot(0.21, 0.21), "keeps_speed");
  EXPECT_EQ(on_foot(1.4, 0.2), "stops");
  EXPECT_EQ(on_foot(0.3, 0.6), "starts");
  EXPECT_EQ(on_foot(1.4, 1.85), "keeps_speed");
  EXPECT_EQ(on_foot(1.4, 1.95), "accelerates");
  EXPECT_EQ(on_foot(1.4, 0.85), "brakes");
  EXPECT_EQ(ClassOf(Shifted(1.1), 10.0, v1::AGENT_TYPE_PEDESTRIAN), "lane_change_left");
  EXPECT_EQ(ClassOf(SpeedChange(1.4, 1.95), 1.4, v1::AGENT_TYPE_CYCLIST), "keeps_speed");
}

TEST(RelativeClassesTest, TheEndSpeedCoversHalfASecondOrAWholeInterval) {
  // 4 m/s, except that noise moved the last waypoint by 20 cm: 2 m/s more over the last interval.
  Trajectory noisy = SpeedChange(4.0, 4.0);
  noisy(49, 0) += 0.2;
  EXPECT_EQ(ClassOf(noisy, 4.0), "keeps_speed");
  Trajectory two(2, 2);
  two << 5.0, 0.0, 6.5, 0.0;
  EXPECT_EQ(ClassifyRelative(two, std::vector{1.0, 2.0}, 5.0), RelativeClass::kBrakes);
  Trajectory one(1, 2);
  one << 20.0, 0.0;
  EXPECT_EQ(ClassifyRelative(one, std::vector{2.0}, 5.0), RelativeClass::kAccelerates);
}

}  // namespace
}  // namespace maneuver::evaluation::relative_classes_test
