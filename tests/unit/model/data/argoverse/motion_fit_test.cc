#include "model/data/argoverse/motion_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace maneuver::data::motion_fit_test {
namespace {

using scene::Point2;

std::vector<double> Clock(int count) {
  std::vector<double> times;
  for (int i = 0; i < count; ++i) times.push_back(0.1 * i);
  return times;
}

TEST(FitVelocitiesTest, GivesTheVelocityOfAConstantAccelerationWithoutDelay) {
  std::vector<double> times = Clock(40);
  for (size_t i = 0; i < times.size(); ++i) times[i] += 0.003 * std::sin(5.0 * i);  // jitter
  std::vector<Point2> positions;
  for (const double t : times) {
    positions.push_back({3.0 + 8.0 * t - 1.5 * t * t, -2.0 * t + 0.5 * t * t});
  }
  const std::vector<Point2> velocities = FitVelocities(times, positions);
  for (size_t i = 10; i < times.size(); ++i) {
    EXPECT_NEAR(velocities[i].x, 8.0 - 3.0 * times[i], 1e-9);
    EXPECT_NEAR(velocities[i].y, -2.0 + times[i], 1e-9);
  }
}

TEST(FitVelocitiesTest, ReadsNothingLaterAfterTheFirstHalfSecond) {
  const std::vector<double> times = Clock(30);
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0.0, 1.0);
  std::vector<Point2> positions;
  for (const double t : times) positions.push_back({5.0 * t + noise(random), noise(random)});
  const std::vector<Point2> whole = FitVelocities(times, positions);
  for (size_t now = 5; now < times.size(); ++now) {
    const std::vector<Point2> until =
        FitVelocities(std::span(times).first(now + 1), std::span(positions).first(now + 1));
    EXPECT_EQ(until[now].x, whole[now].x) << now;
    EXPECT_EQ(until[now].y, whole[now].y) << now;
  }
  for (size_t now = 1; now < 6; ++now) {  // the first half second shares one line
    EXPECT_DOUBLE_EQ(whole[now].x, whole[0].x);
  }
}

// The stated noise, from draws instead of from the equations of least squares.
TEST(FitVelocitiesTest, NoiseOfThePositionsCountsAsStated) {
  constexpr int kDraws = 4000;
  constexpr double kSigma = 0.1;
  const std::vector<double> times = Clock(30);
  std::mt19937 random(4);
  std::normal_distribution<double> noise(0.0, kSigma);
  double squares = 0.0;
  for (int draw = 0; draw < kDraws; ++draw) {
    std::vector<Point2> positions;
    for (const double t : times) positions.push_back({12.0 * t + noise(random), noise(random)});
    const Point2 last = FitVelocities(times, positions).back();
    squares += (last.x - 12.0) * (last.x - 12.0) + last.y * last.y;
  }
  EXPECT_NEAR(std::sqrt(squares / (2.0 * kDraws)) / kSigma, 2.06, 0.05);
}

TEST(FitVelocitiesTest, PositionsOnEitherSideOfAGapHaveNothingInCommon) {
  const std::vector<double> times = {0.0, 0.1, 0.2, 0.9, 1.0, 1.1, 2.0};
  const std::vector<Point2> positions = {{0, 0},   {1, 0},   {2, 0},  {100, 0},
                                         {100, 2}, {100, 4}, {500, 0}};
  const std::vector<Point2> velocities = FitVelocities(times, positions);
  for (size_t i = 0; i < 3; ++i) EXPECT_NEAR(velocities[i].x, 10.0, 1e-9);
  for (size_t i = 3; i < 6; ++i) {
    EXPECT_NEAR(velocities[i].x, 0.0, 1e-9);
    EXPECT_NEAR(velocities[i].y, 20.0, 1e-9);
  }
  EXPECT_EQ(velocities[6].x, 0.0);  // alone
}

TEST(FitVelocitiesTest, OneMissingPositionIsNotAGap) {
  const std::vector<double> times = {0.0, 0.1, 0.3, 0.4, 0.5, 0.6, 0.7};
  std::vector<Point2> positions;
  for (const double t : times) positions.push_back({4.0 * t, 0.0});
  for (const Point2& velocity : FitVelocities(times, positions)) EXPECT_NEAR(velocity.x, 4.0, 1e-9);
}

TEST(FitVelocitiesTest, NoPositionsHaveNoVelocities) { EXPECT_TRUE(FitVelocities({}, {}).empty()); }

}  // namespace
}  // namespace maneuver::data::motion_fit_test
