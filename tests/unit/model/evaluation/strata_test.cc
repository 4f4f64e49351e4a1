#include "model/evaluation/strata.h"

#include <gtest/gtest.h>

#include <string>

namespace maneuver::evaluation::strata_test {
namespace {

std::string StratumOf(size_t dimension, const StratumKeys& keys) {
  const Stratification& stratification = Stratifications()[dimension];
  return std::string(stratification.names[static_cast<size_t>(stratification.stratum(keys))]);
}

TEST(StrataTest, CountsOfAgentsFallIntoTheirRange) {
  EXPECT_EQ(Stratifications()[0].dimension, "agents");
  EXPECT_EQ(StratumOf(0, {.agents = 1}), "<=10");
  EXPECT_EQ(StratumOf(0, {.agents = 10}), "<=10");
  EXPECT_EQ(StratumOf(0, {.agents = 11}), "11-30");
  EXPECT_EQ(StratumOf(0, {.agents = 60}), "31-60");
  EXPECT_EQ(StratumOf(0, {.agents = 61}), ">60");
}

TEST(StrataTest, ASpeedAtALimitBelongsToTheFasterRange) {
  EXPECT_EQ(Stratifications()[1].dimension, "speed");
  EXPECT_EQ(StratumOf(1, {.speed = 0.49}), "standing");
  EXPECT_EQ(StratumOf(1, {.speed = 0.5}), "0.5-5 m/s");
  EXPECT_EQ(StratumOf(1, {.speed = 5.0}), "5-10 m/s");
  EXPECT_EQ(StratumOf(1, {.speed = 14.9}), "10-15 m/s");
  EXPECT_EQ(StratumOf(1, {.speed = 15.0}), ">=15 m/s");
}

TEST(StrataTest, TheSignOfTheHeadingChangeDecidesTheTurn) {
  EXPECT_EQ(Stratifications()[2].dimension, "turn");
  EXPECT_EQ(StratumOf(2, {.heading_change = 0.5}), "straight");
  EXPECT_EQ(StratumOf(2, {.heading_change = 0.55}), "left");
  EXPECT_EQ(StratumOf(2, {.heading_change = -0.55}), "right");
}

TEST(StrataTest, ClassesHaveTheNamesOfKinematicClasses) {
  EXPECT_EQ(Stratifications()[3].dimension, "class");
  EXPECT_EQ(StratumOf(3, {.kinematic_class = KinematicClass::kStationary}), "stationary");
  EXPECT_EQ(StratumOf(3, {.kinematic_class = KinematicClass::kUTurn}), "u_turn");
  EXPECT_EQ(StratumOf(3, {.kinematic_class = KinematicClass::kLaneChangeRight}),
            "lane_change_right");
}

TEST(StrataTest, TheTargetsTypeDecidesTheType) {
  EXPECT_EQ(Stratifications()[4].dimension, "type");
  EXPECT_EQ(StratumOf(4, {}), "vehicle");
  EXPECT_EQ(StratumOf(4, {.type = v1::AGENT_TYPE_PEDESTRIAN}), "pedestrian");
  EXPECT_EQ(StratumOf(4, {.type = v1::AGENT_TYPE_CYCLIST}), "cyclist");
  EXPECT_EQ(StratumOf(4, {.type = v1::AGENT_TYPE_OTHER}), "other");
  EXPECT_EQ(StratumOf(4, {.type = v1::AGENT_TYPE_UNSPECIFIED}), "other");
}

TEST(StrataTest, CountsAgentsWithAStateAtTheTimeOrShortlyBefore) {
  v1::Scenario scenario;
  for (const double time : {0.0, 0.96, 1.0 + 1e-9, 1.04, 2.0}) {
    scenario.add_agents()->add_states()->set_time(time);
  }
  EXPECT_EQ(AgentsAt(scenario, 1.0, 0.05), 2);
  EXPECT_EQ(AgentsAt(scenario, 3.0, 0.05), 0);
}

}  // namespace
}  // namespace maneuver::evaluation::strata_test
