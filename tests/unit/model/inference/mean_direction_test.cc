#include "model/inference/mean_direction.h"

#include <gtest/gtest.h>

#include <cmath>

namespace maneuver::inference::mean_direction_test {
namespace {

TEST(MeanDirectionTest, AStraightMeanHeadsOneWay) {
  Trajectory mean(10, 2);
  for (Eigen::Index t = 0; t < 10; ++t) mean.row(t) << 0.3 * (t + 1), -0.4 * (t + 1);
  const Trajectory directions = MeanDirections(mean, 0.1);
  for (Eigen::Index t = 0; t < 10; ++t) {
    EXPECT_NEAR(directions(t, 0), 0.6, 1e-12);
    EXPECT_NEAR(directions(t, 1), -0.8, 1e-12);
  }
}

// Steps of one length on a circle add up to a chord, whose direction is that of its middle. At an
// interval of 0.1 s the window is five steps, fewer at the ends.
TEST(MeanDirectionTest, AWindowOfACircleHasTheHeadingOfItsMiddle) {
  const double radius = 20.0;
  const double turn = 0.05;  // radians a step
  Trajectory mean(12, 2);
  for (Eigen::Index t = 0; t < 12; ++t) {
    const double angle = turn * static_cast<double>(t + 1);
    mean.row(t) << radius * std::sin(angle), radius * (1 - std::cos(angle));
  }
  const Trajectory directions = MeanDirections(mean, 0.1);
  const auto heading = [&](Eigen::Index t) {
    return std::atan2(directions(t, 1), directions(t, 0));
  };
  for (Eigen::Index t = 2; t < 10; ++t) {
    EXPECT_NEAR(heading(t), turn * (static_cast<double>(t) + 0.5), 1e-9) << t;
  }
  EXPECT_NEAR(heading(0), turn * 1.5, 1e-9);    // steps 0 .. 2
  EXPECT_NEAR(heading(1), turn * 2.0, 1e-9);    // steps 0 .. 3
  EXPECT_NEAR(heading(10), turn * 10.0, 1e-9);  // steps 8 .. 11
  EXPECT_NEAR(heading(11), turn * 10.5, 1e-9);  // steps 9 .. 11
}

TEST(MeanDirectionTest, WaypointsFarApartUseOnlyTheirOwnStep) {
  Trajectory mean(3, 2);
  mean << 5, 0, 5, 5, 0, 5;
  const Trajectory directions = MeanDirections(mean, 0.5);
  EXPECT_NEAR(directions(0, 0), 1.0, 1e-12);
  EXPECT_NEAR(directions(1, 1), 1.0, 1e-12);
  EXPECT_NEAR(directions(2, 0), -1.0, 1e-12);
}

TEST(MeanDirectionTest, ASlowMeanHeadsAlongTheTargetsHeading) {
  Trajectory slow(6, 2), slower(6, 2);
  for (Eigen::Index t = 0; t < 6; ++t) {
    slow.row(t) << 0.0, 0.051 * static_cast<double>(t + 1);    // 0.51 m/s to the left
    slower.row(t) << 0.0, 0.049 * static_cast<double>(t + 1);  // 0.49 m/s
  }
  for (Eigen::Index t = 0; t < 6; ++t) {
    EXPECT_NEAR(MeanDirections(slow, 0.1)(t, 1), 1.0, 1e-12);
    EXPECT_EQ(MeanDirections(slower, 0.1)(t, 0), 1.0);
    EXPECT_EQ(MeanDirections(slower, 0.1)(t, 1), 0.0);
  }
}

}  // namespace
}  // namespace maneuver::inference::mean_direction_test
