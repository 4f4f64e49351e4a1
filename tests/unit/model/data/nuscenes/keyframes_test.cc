#include "model/data/nuscenes/keyframes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace maneuver::data::keyframes_test {
namespace {

using testing::DoubleNear;
using testing::Pointwise;

v1::Agent Frames(const std::vector<Keyframe>& keyframes) {
  v1::Agent agent;
  AddFrames(keyframes, &agent);
  return agent;
}

std::vector<double> Times(const v1::Agent& agent) {
  std::vector<double> times;
  for (const v1::AgentState& state : agent.states()) times.push_back(state.time());
  return times;
}

MATCHER_P(TimesAre, expected, "") {
  return testing::ExplainMatchResult(Pointwise(DoubleNear(1e-9), expected), Times(arg),
                                     result_listener);
}
using Expected = std::vector<double>;

TEST(KeyframesTest, FillsFramesBetweenKeyframesInStraightLines) {
  const v1::Agent agent = Frames({{0.0, 0.0, 0.0, 0.0F}, {0.5, 5.0, -1.0, 0.1F}});
  ASSERT_THAT(agent, TimesAre(Expected{0.0, 0.1, 0.2, 0.3, 0.4, 0.5}));
  for (const v1::AgentState& state : agent.states()) {
    EXPECT_NEAR(state.x(), 10.0 * state.time(), 1e-9);
    EXPECT_NEAR(state.y(), -2.0 * state.time(), 1e-9);
    EXPECT_NEAR(state.heading(), 0.2 * state.time(), 1e-6);
    EXPECT_NEAR(state.velocity_x(), 10.0, 1e-6);
    EXPECT_NEAR(state.velocity_y(), -2.0, 1e-6);
  }
}

TEST(KeyframesTest, AFrameAtAKeyframeHasTheVelocityThatLedThere) {
  const v1::Agent agent =
      Frames({{0.0, 0.0, 0.0, 0.0F}, {0.5, 5.0, 0.0, 0.0F}, {1.0, 6.0, 0.0, 0.0F}});
  ASSERT_EQ(agent.states_size(), 11);
  EXPECT_FLOAT_EQ(agent.states(5).velocity_x(), 10.0F);
  EXPECT_FLOAT_EQ(agent.states(6).velocity_x(), 2.0F);
}

TEST(KeyframesTest, InventsNothingBeforeAfterOrInGaps) {
  const v1::Agent agent = Frames({{0.23, 0.0, 0.0, 0.0F},
                                  {0.74, 1.0, 0.0, 0.0F},
                                  {1.74, 3.0, 0.0, 0.0F},  // a second later: a gap
                                  {2.21, 4.0, 0.0, 0.0F}});
  EXPECT_THAT(agent, TimesAre(Expected{0.3, 0.4, 0.5, 0.6, 0.7, 1.8, 1.9, 2.0, 2.1, 2.2}));
}

TEST(KeyframesTest, AKeyframeAloneHasNoVelocityAndIsLeftOut) {
  EXPECT_EQ(Frames({{0.5, 1.0, 1.0, 0.0F}}).states_size(), 0);
  EXPECT_THAT(Frames({{0.5, 1.0, 1.0, 0.0F}, {2.0, 1.0, 1.0, 0.0F}, {2.5, 1.0, 1.0, 0.0F}}),
              TimesAre(Expected{2.0, 2.1, 2.2, 2.3, 2.4, 2.5}));
}

TEST(KeyframesTest, HeadingsTurnAlongTheShorterArc) {
  const auto pi = static_cast<float>(std::numbers::pi);
  const v1::Agent agent = Frames({{0.0, 0.0, 0.0, pi - 0.1F}, {0.5, 0.0, 0.0, -pi + 0.3F}});
  for (const v1::AgentState& state : agent.states()) {
    const double expected = std::numbers::pi - 0.1 + 0.8 * state.time();
    EXPECT_NEAR(std::remainder(state.heading() - expected, 2.0 * std::numbers::pi), 0.0, 1e-5);
    EXPECT_LE(std::abs(state.heading()), 3.1416F);
  }
}

TEST(KeyframesTest, JitterOfTheClockLosesAndRepeatsNoFrame) {
  std::vector<Keyframe> keyframes;
  for (int i = 0; i < 40; ++i) {
    const double time = 0.5 * i + 0.04 * std::sin(7.0 * i);
    keyframes.push_back({time, 3.0 * time, 0.0, 0.0F});
  }
  const v1::Agent agent = Frames(keyframes);
  ASSERT_GT(agent.states_size(), 190);
  for (int i = 1; i < agent.states_size(); ++i) {
    EXPECT_NEAR(agent.states(i).time() - agent.states(i - 1).time(), 0.1, 1e-9);
    EXPECT_NEAR(agent.states(i).x(), 3.0 * agent.states(i).time(), 1e-6);
  }
}

}  // namespace
}  // namespace maneuver::data::keyframes_test
