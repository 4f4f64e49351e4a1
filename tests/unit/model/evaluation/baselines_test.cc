#include "model/evaluation/baselines.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

namespace maneuver::evaluation::baselines_test {
namespace {

TEST(ConstantVelocityTest, IsLinearInTime) {
  const std::array<double, 2> times = {0.5, 2.0};
  const Trajectory trajectory = ConstantVelocity({.velocity_x = 10.0, .velocity_y = -1.0}, times);
  EXPECT_DOUBLE_EQ(trajectory(0, 0), 5.0);
  EXPECT_DOUBLE_EQ(trajectory(1, 0), 20.0);
  EXPECT_DOUBLE_EQ(trajectory(1, 1), -2.0);
}

// Integrates the equation of motion in small steps, by the midpoint rule.
Eigen::RowVector2d Integrate(double v, double a, double w, double end) {
  constexpr int kSteps = 100'000;
  Eigen::RowVector2d position(0.0, 0.0);
  const double dt = end / kSteps;
  for (int i = 0; i < kSteps; ++i) {
    const double t = (i + 0.5) * dt;
    const double speed = v + a * t;
    if (v * speed <= 0.0 && a != 0.0) break;  // has stopped
    position += dt * speed * Eigen::RowVector2d(std::cos(w * t), std::sin(w * t));
  }
  return position;
}

TEST(ConstantTurnRateAndAccelerationTest, SolvesItsEquationOfMotion) {
  struct Case {
    double v, a, w;
  };
  for (const Case& each : {Case{10.0, 0.0, 0.0}, Case{10.0, 1.5, 0.0}, Case{8.0, 0.0, 0.4},
                           Case{8.0, 1.0, -0.3}, Case{12.0, -1.0, 0.00005},
                           Case{12.0, -1.0, 0.00015}, Case{6.0, -2.0, 0.5}, Case{-3.0, 1.0, 0.2}}) {
    const std::array<double, 3> times = {0.2, 2.5, 5.0};
    const Trajectory trajectory = ConstantTurnRateAndAcceleration(
        {.velocity_x = each.v, .acceleration = each.a, .turn_rate = each.w}, times);
    for (int i = 0; i < 3; ++i) {
      const Eigen::RowVector2d expected = Integrate(each.v, each.a, each.w, times[i]);
      EXPECT_LT((trajectory.row(i) - expected).norm(), 1e-3)
          << each.v << " " << each.a << " " << each.w << " at " << times[i];
    }
  }
}

TEST(ConstantTurnRateAndAccelerationTest, ABrakingVehicleStopsAndStays) {
  const std::array<double, 3> times = {2.0, 3.0, 5.0};
  const Trajectory trajectory =
      ConstantTurnRateAndAcceleration({.velocity_x = 4.0, .acceleration = -2.0}, times);
  EXPECT_DOUBLE_EQ(trajectory(0, 0), 4.0);
  EXPECT_DOUBLE_EQ(trajectory(1, 0), 4.0);
  EXPECT_DOUBLE_EQ(trajectory(2, 0), 4.0);
}

TEST(ConstantTurnRateAndAccelerationTest, AVehicleThatHasJustStoppedStays) {
  const std::array<double, 2> times = {1.0, 5.0};
  for (const double turn_rate : {0.0, 0.3}) {
    const Trajectory trajectory = ConstantTurnRateAndAcceleration(
        {.velocity_x = 0.0, .acceleration = -2.0, .turn_rate = turn_rate}, times);
    EXPECT_DOUBLE_EQ(trajectory.cwiseAbs().maxCoeff(), 0.0);
  }
}

// A vehicle that accelerates by 2 m/s^2 and turns left by 0.3 rad/s through the heading pi, its
// velocity along its heading. At time 10 it drives 5 m/s with heading 3.1 rad.
v1::Agent Turning(double from, double to) {
  v1::Agent agent;
  for (int i = static_cast<int>(std::lround(10.0 * from)); i <= std::lround(10.0 * to); ++i) {
    const double t = 0.1 * i;
    const double heading = 3.1 + 0.3 * (t - 10.0);
    const double speed = 5.0 + 2.0 * (t - 10.0);
    v1::AgentState& state = *agent.add_states();
    state.set_time(t);
    state.set_heading(static_cast<float>(std::remainder(heading, 2.0 * std::numbers::pi)));
    state.set_velocity_x(static_cast<float>(speed * std::cos(heading)));
    state.set_velocity_y(static_cast<float>(speed * std::sin(heading)));
  }
  return agent;
}

TEST(FadedRollOutTest, AccelerationAndTurnRateFadeFromTheirPresentValues) {
  const v1::Agent agent = Turning(9.0, 15.0);  // later states are ignored
  const std::array<double, 3> times = {0.5, 2.0, 5.0};
  const Trajectory trajectory = FadedRollOut(agent, 10.0, scene::Pose2(0.0, 0.0, 3.1), times);
  // v = 5 + 2 f, h = 0.3 f, f = 1 - e^-t, in small steps.
  Eigen::RowVector2d position(0.0, 0.0);
  constexpr double kStep = 1e-4;
  size_t next = 0;
  for (int i = 0; next < times.size(); ++i) {
    const double faded = 1.0 - std::exp(-(i + 0.5) * kStep);
    position += kStep * (5.0 + 2.0 * faded) *
                Eigen::RowVector2d(std::cos(0.3 * faded), std::sin(0.3 * faded));
    if ((i + 1) * kStep < times[next] - 0.5 * kStep) continue;
    EXPECT_LT((trajectory.row(static_cast<Eigen::Index>(next)) - position).norm(), 5e-3);
    ++next;
  }
}

TEST(MotionAtTest, ReadsVelocityAccelerationAndTurnRate) {
  const Motion motion = MotionAt(Turning(9.0, 15.0), 10.0);
  EXPECT_NEAR(motion.velocity_x, 5.0, 1e-5);
  EXPECT_NEAR(motion.velocity_y, 0.0, 1e-5);
  EXPECT_NEAR(motion.acceleration, 2.0, 1e-5);
  EXPECT_NEAR(motion.turn_rate, 0.3, 1e-5);
  EXPECT_NEAR(motion.speed(), 5.0, 1e-5);
}

TEST(MotionAtTest, UnwrapsHeadingsThroughPi) {
  EXPECT_NEAR(MotionAt(Turning(9.0, 15.0), 10.5).turn_rate, 0.3, 1e-5);
}

TEST(MotionAtTest, LooksNeitherAheadNorFurtherBackThanASecond) {
  v1::Agent agent = Turning(5.0, 15.0);
  for (v1::AgentState& state : *agent.mutable_states()) {
    if (state.time() < 8.95 || state.time() > 10.05) {
      state.set_heading(0.7F);
      state.set_velocity_x(100.0F);
    }
  }
  const Motion motion = MotionAt(agent, 10.0);
  EXPECT_NEAR(motion.acceleration, 2.0, 1e-5);
  EXPECT_NEAR(motion.turn_rate, 0.3, 1e-5);
}

TEST(MotionAtTest, ASingleStateHasNoAccelerationOrTurnRate) {
  const Motion motion = MotionAt(Turning(10.0, 15.0), 10.0);
  EXPECT_NEAR(motion.velocity_x, 5.0, 1e-5);
  EXPECT_EQ(motion.acceleration, 0.0);
  EXPECT_EQ(motion.turn_rate, 0.0);
}

}  // namespace
}  // namespace maneuver::evaluation::baselines_test
