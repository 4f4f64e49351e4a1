#include "model/evaluation/waymo_displacement.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace maneuver::evaluation::waymo_displacement_test {
namespace {

std::vector<double> Times(double interval, int count) {
  std::vector<double> times;
  for (int i = 1; i <= count; ++i) times.push_back(interval * i);
  return times;
}

// Returns a trajectory at 2 Hz at the origin, displaced by (x, y) from `from` seconds on.
Trajectory Off(int count, double from, double x, double y) {
  Trajectory trajectory = Trajectory::Zero(count, 2);
  for (int i = 0; i < count; ++i) {
    if (0.5 * (i + 1) >= from) trajectory.row(i) << x, y;
  }
  return trajectory;
}

double Misses(const WaymoMeasure& measure, const Trajectory& predicted, double heading,
              double speed) {
  const Trajectory truth = Trajectory::Zero(predicted.rows(), 2);
  const std::vector<double> headings(measure.measured_times().size(), heading);
  return measure.BestOf({&predicted, 1}, 1, truth, headings, speed).miss_rate;
}

TEST(WaymoDisplacementTest, ThresholdsScaleWithSpeedBetweenTheirLimits) {
  EXPECT_DOUBLE_EQ(WaymoSpeedScale(0.0), 0.5);
  EXPECT_DOUBLE_EQ(WaymoSpeedScale(1.4), 0.5);
  EXPECT_DOUBLE_EQ(WaymoSpeedScale(6.2), 0.75);
  EXPECT_DOUBLE_EQ(WaymoSpeedScale(11.0), 1.0);
  EXPECT_DOUBLE_EQ(WaymoSpeedScale(30.0), 1.0);
  EXPECT_DOUBLE_EQ(ThresholdsAt(3.0, 20.0).lateral, 1.0);
  EXPECT_DOUBLE_EQ(ThresholdsAt(5.0, 20.0).longitudinal, 3.6);
  EXPECT_DOUBLE_EQ(ThresholdsAt(8.0, 20.0).lateral, 3.0);
  EXPECT_DOUBLE_EQ(ThresholdsAt(8.0, 0.0).longitudinal, 3.0);
}

TEST(WaymoDisplacementTest, MeasuresTheTimesThatTheHorizonReaches) {
  EXPECT_EQ(WaymoMeasure(Times(0.5, 5)).measured_times(), std::vector<double>{});
  EXPECT_EQ(WaymoMeasure(Times(0.2, 15)).measured_times(), (std::vector{3.0}));
  EXPECT_EQ(WaymoMeasure(Times(0.1, 50)).measured_times(), (std::vector{3.0, 5.0}));
  EXPECT_EQ(WaymoMeasure(Times(0.5, 20)).measured_times(), (std::vector{3.0, 5.0, 8.0}));
}

// At 3 s and full speed, 2 m along the heading and 1 m across it are allowed.
TEST(WaymoDisplacementTest, MeasuresMissesAlongAndAcrossTheTruthsHeading) {
  const WaymoMeasure measure(Times(0.5, 6));
  EXPECT_EQ(Misses(measure, Off(6, 0.0, 1.9, 0.9), 0.0, 20.0), 0.0);
  EXPECT_EQ(Misses(measure, Off(6, 0.0, 2.1, 0.0), 0.0, 20.0), 1.0);
  EXPECT_EQ(Misses(measure, Off(6, 0.0, 0.0, -1.1), 0.0, 20.0), 1.0);
  EXPECT_EQ(Misses(measure, Off(6, 0.0, 0.9, -1.9), 0.5 * std::numbers::pi, 20.0), 0.0);
  EXPECT_EQ(Misses(measure, Off(6, 0.0, 1.9, 0.9), 0.5 * std::numbers::pi, 20.0), 1.0);
}

// For a truth that heads 30 degrees to the left, 1.9 m ahead is a hit and 2.1 m is not. For one
// that heads to the right, neither is.
TEST(WaymoDisplacementTest, HeadingsTurnCounterClockwise) {
  const WaymoMeasure measure(Times(0.5, 6));
  const double heading = std::numbers::pi / 6.0;
  const Trajectory ahead = Off(6, 0.0, 1.9 * std::cos(heading), 1.9 * std::sin(heading));
  EXPECT_EQ(Misses(measure, ahead, heading, 20.0), 0.0);
  EXPECT_EQ(Misses(measure, ahead, -heading, 20.0), 1.0);
  const Trajectory too_far = Off(6, 0.0, 2.1 * std::cos(heading), 2.1 * std::sin(heading));
  EXPECT_EQ(Misses(measure, too_far, heading, 20.0), 1.0);
}

TEST(WaymoDisplacementTest, SlowTargetsAllowHalfAsMuch) {
  const WaymoMeasure measure(Times(0.5, 6));
  EXPECT_EQ(Misses(measure, Off(6, 0.0, 1.1, 0.0), 0.0, 1.0), 1.0);
  EXPECT_EQ(Misses(measure, Off(6, 0.0, 0.9, 0.0), 0.0, 1.0), 0.0);
}

// 2.5 m ahead is a miss at 3 s and a hit at 5 s. Errors between the measured times do not matter.
TEST(WaymoDisplacementTest, AveragesMissesOverTheMeasuredTimes) {
  const WaymoMeasure measure(Times(0.5, 10));
  EXPECT_EQ(Misses(measure, Off(10, 0.0, 2.5, 0.0), 0.0, 20.0), 0.5);
  Trajectory wild = Trajectory::Zero(10, 2);
  wild.row(7) << 50.0, 50.0;  // 4 s
  EXPECT_EQ(Misses(measure, wild, 0.0, 20.0), 0.0);
}

// Different predictions may hit at different times. At each time, one hit among them is enough.
TEST(WaymoDisplacementTest, OneHitAmongTheFirstKIsEnough) {
  const WaymoMeasure measure(Times(0.5, 10));
  const Trajectory truth = Trajectory::Zero(10, 2);
  const std::vector<double> headings = {0.0, 0.0};
  Trajectory late = Trajectory::Zero(10, 2);
  late.row(5) << 9.0, 0.0;  // 3 s
  const std::vector<Trajectory> ranked = {Off(10, 4.0, 9.0, 0.0), late};
  EXPECT_EQ(measure.BestOf(ranked, 1, truth, headings, 20.0).miss_rate, 0.5);
  EXPECT_EQ(measure.BestOf(ranked, 2, truth, headings, 20.0).miss_rate, 0.0);
}

// 1 m off from 4 s on: no error up to 3 s, three of ten steps up to 5 s.
TEST(WaymoDisplacementTest, AveragesDisplacementUpToEachMeasuredTime) {
  const WaymoMeasure measure(Times(0.5, 10));
  const Trajectory truth = Trajectory::Zero(10, 2);
  const Trajectory predicted = Off(10, 4.0, 0.0, 1.0);
  const std::vector<double> headings = {0.0, 0.0};
  const WaymoErrors errors = measure.BestOf({&predicted, 1}, 1, truth, headings, 20.0);
  EXPECT_DOUBLE_EQ(errors.min_ade, 0.5 * (0.0 + 0.3));
  EXPECT_DOUBLE_EQ(errors.min_fde, 0.5 * (0.0 + 1.0));
}

// An error that grows by 1 m per second, at 2 Hz: 0.5, 1, ... 3 m, mean 1.75, for any waypoints.
TEST(WaymoDisplacementTest, SamplesAtTwoHertzBetweenWaypointsToo) {
  for (const double interval : {0.1, 0.2, 0.75, 1.0}) {
    const WaymoMeasure measure(Times(interval, static_cast<int>(3.01 / interval)));
    const int count = static_cast<int>(3.01 / interval);
    const Trajectory truth = Trajectory::Zero(count, 2);
    Trajectory predicted = truth;
    for (int i = 0; i < count; ++i) predicted(i, 0) = interval * (i + 1);
    const std::vector<double> headings = {0.0};
    const WaymoErrors errors = measure.BestOf({&predicted, 1}, 1, truth, headings, 20.0);
    EXPECT_NEAR(errors.min_ade, 1.75, 1e-9) << interval;
    EXPECT_NEAR(errors.min_fde, 3.0, 1e-9) << interval;
  }
}

}  // namespace
}  // namespace maneuver::evaluation::waymo_displacement_test
