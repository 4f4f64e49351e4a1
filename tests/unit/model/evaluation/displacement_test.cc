#include "model/evaluation/displacement.h"

#include <gtest/gtest.h>

#include <array>
#include <vector>

namespace maneuver::evaluation {
namespace {

Trajectory Line(double y, std::initializer_list<double> x) {
  Trajectory trajectory(x.size(), 2);
  int t = 0;
  for (const double value : x) trajectory.row(t++) << value, y;
  return trajectory;
}

TEST(DisplacementTest, AveragesDistancesAndTakesTheLast) {
  const Trajectory truth = Line(0.0, {1.0, 2.0, 3.0});
  Trajectory predicted = truth;
  predicted.row(1) += Eigen::RowVector2d(3.0, 4.0);   // 5 m off
  predicted.row(2) += Eigen::RowVector2d(0.0, -1.0);  // 1 m off
  EXPECT_DOUBLE_EQ(AverageDisplacement(predicted, truth), 2.0);
  EXPECT_DOUBLE_EQ(FinalDisplacement(predicted, truth), 1.0);
}

TEST(DisplacementTest, BestOfLooksAtTheFirstKOnlyAndMinimisesEachErrorOnItsOwn) {
  const Trajectory truth = Line(0.0, {0.0, 0.0});
  const std::vector<Trajectory> ranked = {
      Line(0.0, {9.0, 9.0}),   // ADE 9, FDE 9
      Line(0.0, {0.0, 4.0}),   // ADE 2, FDE 4
      Line(0.0, {10.0, 3.0}),  // ADE 6.5, FDE 3
      Line(0.0, {0.0, 0.0}),
  };
  EXPECT_DOUBLE_EQ(BestOf(ranked, 1, truth).min_ade, 9.0);
  EXPECT_DOUBLE_EQ(BestOf(ranked, 3, truth).min_ade, 2.0);
  EXPECT_DOUBLE_EQ(BestOf(ranked, 3, truth).min_fde, 3.0);
  EXPECT_TRUE(BestOf(ranked, 3, truth).missed);
  EXPECT_DOUBLE_EQ(BestOf(ranked, 10, truth).min_ade, 0.0);
  EXPECT_FALSE(BestOf(ranked, 10, truth).missed);
}

TEST(DisplacementTest, MissesBeyondTwoMetresAlone) {
  const Trajectory truth = Line(0.0, {0.0});
  const Trajectory at_two = Line(2.0, {0.0});
  const Trajectory beyond = Line(2.001, {0.0});
  EXPECT_FALSE(BestOf({&at_two, 1}, 1, truth).missed);
  EXPECT_TRUE(BestOf({&beyond, 1}, 1, truth).missed);
}

TEST(DisplacementTest, ConstantVelocityIsLinearInTime) {
  const std::array<double, 2> times = {0.5, 2.0};
  const Trajectory trajectory = ConstantVelocity(10.0, -1.0, times);
  EXPECT_DOUBLE_EQ(trajectory(0, 0), 5.0);
  EXPECT_DOUBLE_EQ(trajectory(1, 0), 20.0);
  EXPECT_DOUBLE_EQ(trajectory(1, 1), -2.0);
}

}  // namespace
}  // namespace maneuver::evaluation
