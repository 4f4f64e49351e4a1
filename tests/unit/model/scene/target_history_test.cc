#include "model/scene/target_history.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

namespace maneuver::scene::target_history_test {
namespace {

// Returns a vehicle at 10 Hz from -1 s to +1 s about `now`. Speed and heading are functions of the
// time since `now`; the position is integrated in small steps.
v1::Agent Drive(double now, const std::function<double(double)>& speed,
                const std::function<double(double)>& heading) {
  v1::Agent agent;
  agent.set_id(1);
  agent.set_type(v1::AGENT_TYPE_VEHICLE);
  agent.set_length(4.6);
  agent.set_width(2.0);
  constexpr int kSubsteps = 1000;
  double x = 30.0, y = -12.0;
  for (int i = -10; i <= 10; ++i) {
    const double t = 0.1 * i;
    v1::AgentState& state = *agent.add_states();
    state.set_time(now + t);
    state.set_x(x);
    state.set_y(y);
    state.set_heading(static_cast<float>(std::remainder(heading(t), 2.0 * std::numbers::pi)));
    state.set_velocity_x(static_cast<float>(speed(t) * std::cos(heading(t))));
    state.set_velocity_y(static_cast<float>(speed(t) * std::sin(heading(t))));
    for (int j = 0; j < kSubsteps; ++j) {
      const double s = t + 0.1 * (j + 0.5) / kSubsteps;
      x += speed(s) * std::cos(heading(s)) * 0.1 / kSubsteps;
      y += speed(s) * std::sin(heading(s)) * 0.1 / kSubsteps;
    }
  }
  return agent;
}

Pose2 PoseNow(const v1::Agent& agent) {
  const v1::AgentState& now = agent.states(10);
  return Pose2(now.x(), now.y(), now.heading());
}

TEST(TargetHistoryTest, EstimatesAConstantAccelerationAndTurnRateExactly) {
  const v1::Agent agent = Drive(
      7.0, [](double t) { return 8.0 + 1.5 * t; }, [](double t) { return 3.0 + 0.3 * t; });
  const MotionEstimate motion = EstimateMotion(ResampleHistory(agent, 7.0, PoseNow(agent)));
  EXPECT_NEAR(motion.speed, 8.0, 1e-5);
  EXPECT_NEAR(motion.lateral_speed, 0.0, 1e-5);
  EXPECT_NEAR(motion.acceleration, 1.5, 1e-4);
  EXPECT_NEAR(motion.turn_rate, 0.3, 1e-4);
  EXPECT_NEAR(motion.speed_change, 0.75, 1e-4);
  EXPECT_NEAR(motion.earlier_change, 0.75, 1e-4);
  EXPECT_NEAR(motion.heading_change, 0.15, 1e-5);
}

TEST(TargetHistoryTest, ShrinksSlopesByTheNoiseOfTheirFits) {
  // Alternating errors, by hand: the slope of +-e over 11 states is 0, because the sum about the
  // mean is.
  TargetHistory history;
  constexpr double kError = 0.4;
  for (size_t i = 0; i < kHistoryStates; ++i) {
    const double t = 0.1 * (static_cast<double>(i) - 10.0);
    history.states[i].velocity_x = 10.0 + 2.0 * t + (i % 2 == 0 ? kError : -kError);
  }
  // Residuals of a line through 11 alternating errors that begin and end with +e. The mean is e/11
  // and the slope 0 by symmetry, so their squares sum to 11 e^2 - e^2 / 11.
  const double variance = (11.0 - 1.0 / 11.0) * kError * kError / 9.0;
  EXPECT_NEAR(EstimateMotion(history).acceleration, 2.0 / (1.0 + 30.0 * variance / 1.1), 1e-9);

  for (size_t i = 0; i < kHistoryStates; ++i) {
    const double t = 0.1 * (static_cast<double>(i) - 10.0);
    history.states[i] = {};
    history.states[i].heading = 0.2 * t + (i % 2 == 0 ? 0.01 : -0.01);
  }
  const double spread = (11.0 - 1.0 / 11.0) * 0.01 * 0.01 / 9.0;
  EXPECT_NEAR(EstimateMotion(history).turn_rate, 0.2 / (1.0 + 100.0 * spread / (1.1 * 0.12 * 0.12)),
              1e-9);
}

TEST(TargetHistoryTest, ReadsNothingLaterThanThePredictionTime) {
  v1::Agent agent = Drive(
      0.0, [](double t) { return 5.0 + t; }, [](double) { return 1.0; });
  const Pose2 pose = PoseNow(agent);
  const auto before = DescribeHistory(ResampleHistory(agent, 0.0, pose),
                                      EstimateMotion(ResampleHistory(agent, 0.0, pose)));
  for (int i = 11; i < agent.states_size(); ++i) agent.mutable_states(i)->set_velocity_x(99.0F);
  const TargetHistory after = ResampleHistory(agent, 0.0, pose);
  EXPECT_EQ(DescribeHistory(after, EstimateMotion(after)), before);
}

TEST(TargetHistoryTest, InterpolatesBetweenStatesAndExtrapolatesBeforeTheFirst) {
  v1::Agent agent;
  for (const auto& [time, x, speed] :
       std::vector<std::array<double, 3>>{{-0.4, 1.0, 2.0}, {0.0, 3.0, 6.0}}) {
    v1::AgentState& state = *agent.add_states();
    state.set_time(time);
    state.set_x(x);
    state.set_velocity_x(static_cast<float>(speed));
  }
  const TargetHistory history = ResampleHistory(agent, 0.0, Pose2(3.0, 0.0, 0.0));
  EXPECT_NEAR(history.states[10].x, 0.0, 1e-12);
  EXPECT_NEAR(history.states[9].x, -0.5, 1e-6);
  EXPECT_NEAR(history.states[9].velocity_x, 5.0, 1e-6);
  EXPECT_NEAR(history.states[6].x, -2.0, 1e-6);
  EXPECT_NEAR(history.states[0].x, -2.0 - 0.6 * 2.0, 1e-6);
  EXPECT_NEAR(history.states[0].velocity_x, 2.0, 1e-6);
  // With a shorter past, the present velocity is extended further back.
  const TargetHistory shorter = ResampleHistory(agent, 0.0, Pose2(3.0, 0.0, 0.0), 0.2);
  EXPECT_NEAR(shorter.states[0].x, -6.0, 1e-6);
}

TEST(TargetHistoryTest, GoesOnFromALatestStateThatIsALittleOld) {
  const v1::Agent agent = Drive(
      0.0, [](double) { return 8.0; }, [](double) { return 0.3; });
  v1::Agent late = agent;  // without the states from -0.1 s on
  while (late.states().rbegin()->time() > -0.15) late.mutable_states()->RemoveLast();
  const Pose2 pose = PoseNow(agent);
  const TargetHistory expected = ResampleHistory(agent, 0.0, pose);
  const TargetHistory history = ResampleHistory(late, 0.0, pose);
  for (size_t i = 0; i < history.states.size(); ++i) {
    EXPECT_NEAR(history.states[i].x, expected.states[i].x, 1e-5) << i;
    EXPECT_NEAR(history.states[i].y, expected.states[i].y, 1e-5) << i;
    EXPECT_NEAR(history.states[i].velocity_x, expected.states[i].velocity_x, 1e-5) << i;
  }
}

TEST(TargetHistoryTest, DoesNotDependOnWhereTheWorldIs) {
  const v1::Agent agent = Drive(
      2.0, [](double t) { return 9.0 - 2.0 * t; }, [](double t) { return 3.1 + 0.5 * t; });
  v1::Agent moved = agent;
  const Pose2 X(100.0, -40.0, 2.0);
  for (v1::AgentState& state : *moved.mutable_states()) {
    const Point2 p = X * Point2{state.x(), state.y()};
    const Point2 v = Pose2(0.0, 0.0, 2.0) * Point2{state.velocity_x(), state.velocity_y()};
    state.set_x(p.x);
    state.set_y(p.y);
    state.set_heading(
        static_cast<float>(std::remainder(state.heading() + 2.0, 2.0 * std::numbers::pi)));
    state.set_velocity_x(static_cast<float>(v.x));
    state.set_velocity_y(static_cast<float>(v.y));
  }
  const TargetHistory here = ResampleHistory(agent, 2.0, PoseNow(agent));
  const TargetHistory there = ResampleHistory(moved, 2.0, PoseNow(moved));
  const HistoryInputs a = DescribeHistory(here, EstimateMotion(here));
  const HistoryInputs b = DescribeHistory(there, EstimateMotion(there));
  for (size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], b[i], 1e-4) << i;
}

TEST(TargetHistoryTest, AMirrorChangesTheSignOfLateralNumbers) {
  const v1::Agent agent = Drive(
      0.0, [](double t) { return 6.0 + t; }, [](double t) { return 0.4 * t; });
  const TargetHistory history = ResampleHistory(agent, 0.0, PoseNow(agent));
  const TargetHistory mirrored = Mirrored(history);
  const HistoryInputs a = DescribeHistory(history, EstimateMotion(history));
  const HistoryInputs b = DescribeHistory(mirrored, EstimateMotion(mirrored));
  for (const size_t i : {1, 3, 6}) EXPECT_FLOAT_EQ(a[i], -b[i]) << i;
  for (const size_t i : {0, 2, 4, 5, 7, 8, 39, 40, 41}) EXPECT_FLOAT_EQ(a[i], b[i]) << i;
  EXPECT_GT(std::abs(a[3]), 0.5F);
}

TEST(TargetHistoryTest, NoiseTurnsTheFrameAndLeavesStandingVehiclesStill) {
  const v1::Agent agent = Drive(
      0.0, [](double) { return 7.0; }, [](double) { return 0.5; });
  const TargetHistory history = ResampleHistory(agent, 0.0, PoseNow(agent));
  const NoisyHistory none = WithNoise(history, {});
  EXPECT_EQ(none.heading_error, 0.0);
  EXPECT_EQ(none.history.states[0].x, history.states[0].x);

  const SensorNoise noise{.speed_stddev = 0.3, .heading_stddev = 0.02, .seed = 5};
  const NoisyHistory noisy = WithNoise(history, noise);
  EXPECT_EQ(WithNoise(history, noise).history.states[3].x, noisy.history.states[3].x);
  EXPECT_NE(noisy.heading_error, 0.0);
  EXPECT_NEAR(noisy.history.states[10].heading, 0.0, 1e-12);
  // Positions have no noise: in the turned frame they are where they were.
  for (size_t i = 0; i < kHistoryStates; ++i) {
    const Point2 p =
        Pose2(0.0, 0.0, noisy.heading_error).ToLocal({history.states[i].x, history.states[i].y});
    EXPECT_NEAR(noisy.history.states[i].x, p.x, 1e-12);
    EXPECT_NEAR(noisy.history.states[i].y, p.y, 1e-12);
  }
  TargetHistory standing;
  const NoisyHistory still = WithNoise(standing, {.speed_stddev = 0.5, .seed = 1});
  for (const PastState& state : still.history.states) EXPECT_EQ(state.velocity_x, 0.0);
}

TEST(TargetHistoryTest, NoiseHasTheStatedStrengthAndCorrelation) {
  TargetHistory history;
  for (PastState& state : history.states) state.velocity_x = 10.0;
  double squares = 0.0, products = 0.0;
  constexpr int kDraws = 4000;
  for (int seed = 0; seed < kDraws; ++seed) {
    const NoisyHistory noisy =
        WithNoise(history, {.speed_stddev = 0.2, .seed = static_cast<uint64_t>(seed)});
    const double a = noisy.history.states[4].velocity_x - 10.0;
    const double b = noisy.history.states[5].velocity_x - 10.0;
    squares += a * a / kDraws;
    products += a * b / kDraws;
  }
  EXPECT_NEAR(std::sqrt(squares), 0.2, 0.01);
  EXPECT_NEAR(products / squares, 0.7, 0.05);
}

}  // namespace
}  // namespace maneuver::scene::target_history_test
