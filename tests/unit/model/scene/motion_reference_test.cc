#include "model/scene/motion_reference.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "model/scene/inputs_version.h"

namespace maneuver::scene::motion_reference_test {
namespace {

std::vector<double> Times(int count, double interval) {
  std::vector<double> times;
  for (int i = 1; i <= count; ++i) times.push_back(i * interval);
  return times;
}

std::vector<double> Fading(const MotionEstimate& motion, const std::vector<double>& times,
                           int version = kLatestInputsVersion) {
  std::vector<double> reference(2 * times.size());
  RollOut(v1::TRAJECTORY_REFERENCE_FADING_MOTION, version, motion, times, reference);
  return reference;
}

TEST(MotionReferenceTest, StraightMotionMatchesTheClosedIntegralOfTheFadingAcceleration) {
  // x(t) = v0 t + a0 tau (t - f(t)), f(t) = tau (1 - e^(-t / tau)), tau = 1 s.
  for (const double acceleration : {-1.0, 0.0, 2.5}) {
    const std::vector<double> times = Times(50, 0.1);
    const std::vector<double> r = Fading({.speed = 9.0, .acceleration = acceleration}, times);
    for (size_t i = 0; i < times.size(); ++i) {
      const double t = times[i];
      EXPECT_NEAR(r[2 * i], 9.0 * t + acceleration * (t - (1.0 - std::exp(-t))), 3e-3);
      EXPECT_EQ(r[2 * i + 1], 0.0);
    }
  }
}

TEST(MotionReferenceTest, AgreesWithAFineIntegrationOfTheTurn) {
  const MotionEstimate motion{.speed = 7.0, .acceleration = 1.2, .turn_rate = -0.6};
  const std::vector<double> times = Times(16, 0.5);
  const std::vector<double> r = Fading(motion, times);
  double x = 0.0, y = 0.0;
  constexpr double kStep = 1e-4;
  size_t next = 0;
  for (int64_t i = 0; next < times.size(); ++i) {
    const double t = (static_cast<double>(i) + 0.5) * kStep;
    const double f = 1.0 - std::exp(-t);
    x += (motion.speed + motion.acceleration * f) * std::cos(motion.turn_rate * f) * kStep;
    y += (motion.speed + motion.acceleration * f) * std::sin(motion.turn_rate * f) * kStep;
    if (static_cast<double>(i + 1) * kStep < times[next] - 1e-9) continue;
    EXPECT_NEAR(r[2 * next], x, 0.02) << times[next];
    EXPECT_NEAR(r[2 * next + 1], y, 0.02) << times[next];
    ++next;
  }
}

TEST(MotionReferenceTest, BrakingStopsAndDoesNotReverse) {
  const std::vector<double> times = Times(50, 0.1);
  const std::vector<double> r = Fading({.speed = 1.0, .acceleration = -3.0}, times);
  for (size_t i = 1; i < times.size(); ++i) EXPECT_GE(r[2 * i], r[2 * i - 2]);
  EXPECT_EQ(r[98], r[96]);
  EXPECT_LT(r[98], 0.5);
}

// The past second of a vehicle that has just stopped shows how it braked. Its speed is 0 to within
// the noise of a sensor, of either sign.
TEST(MotionReferenceTest, AVehicleThatHasJustStoppedStaysThere) {
  const std::vector<double> times = Times(50, 0.1);
  for (const double speed : {0.01, 1e-6, 0.0, -1e-6, -0.01}) {
    const std::vector<double> r = Fading({.speed = speed, .acceleration = -2.0}, times);
    for (size_t i = 0; i < times.size(); ++i) {
      EXPECT_NEAR(r[2 * i], 0.0, 0.051) << speed << " " << times[i];
    }
    // As models of version 1 learned it.
    const double x = Fading({.speed = speed, .acceleration = -2.0}, times, 1)[98];
    EXPECT_NEAR(x, speed > 0.0 ? 0.0 : 5 * speed - 2.0 * (5.0 - 1.0 + std::exp(-5.0)), 0.01);
  }
}

TEST(MotionReferenceTest, BackingSlowsDownButDoesNotSpeedUp) {
  const std::vector<double> times = Times(50, 0.1);
  const std::vector<double> r = Fading({.speed = -2.0, .acceleration = -1.0}, times);
  EXPECT_NEAR(r[98], -10.0, 1e-9);
  EXPECT_GT(Fading({.speed = -2.0, .acceleration = 1.0}, times)[98], -7.0);
}

TEST(MotionReferenceTest, BoundsImpossibleAccelerationsAndTurns) {
  const std::vector<double> times = Times(10, 0.5);
  EXPECT_EQ(Fading({.speed = 5.0, .acceleration = 1e3, .turn_rate = 1e3}, times),
            Fading({.speed = 5.0, .acceleration = 4.0, .turn_rate = 1.0}, times));
}

TEST(MotionReferenceTest, ConstantVelocityIsStraightAndNoReferenceIsZero) {
  const std::vector<double> times = Times(4, 0.5);
  const MotionEstimate motion{.speed = 3.0, .acceleration = 2.0, .turn_rate = 0.5};
  std::vector<double> r(8, 7.0);
  RollOut(v1::TRAJECTORY_REFERENCE_CONSTANT_VELOCITY, kLatestInputsVersion, motion, times, r);
  EXPECT_EQ(r, (std::vector<double>{1.5, 0.0, 3.0, 0.0, 4.5, 0.0, 6.0, 0.0}));
  RollOut(v1::TRAJECTORY_REFERENCE_NONE, kLatestInputsVersion, motion, times, r);
  EXPECT_EQ(r, std::vector<double>(8, 0.0));
}

}  // namespace
}  // namespace maneuver::scene::motion_reference_test
