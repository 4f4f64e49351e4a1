#include "model/data/example_index.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <set>
#include <string>

#include "model/data/stable_hash.h"

namespace maneuver::data::example_index_test {
namespace {

using testing::DoubleNear;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pointwise;

// Frames every 0.1 s over the past second; waypoints every 0.5 s over two seconds.
v1::ModelSpec Spec() {
  v1::ModelSpec spec;
  spec.mutable_raster()->set_history_frames(11);
  spec.mutable_raster()->mutable_frame_interval()->set_nanos(100'000'000);
  spec.mutable_trajectory()->set_waypoints(4);
  spec.mutable_trajectory()->mutable_waypoint_interval()->set_nanos(500'000'000);
  return spec;
}

v1::ExampleSettings Settings() {
  v1::ExampleSettings settings;
  settings.mutable_stride()->set_nanos(500'000'000);
  settings.set_keep_standing(1.0);
  settings.set_standing_distance(1.0);
  settings.set_max_speed(45.0);
  return settings;
}

// Returns a vehicle that drives along +x at `speed`, with a state every 0.1 s from `start` on.
v1::Agent Vehicle(int64_t id, double start, int states, double speed) {
  v1::Agent agent;
  agent.set_id(id);
  agent.set_type(v1::AGENT_TYPE_VEHICLE);
  agent.set_length(4.5);
  agent.set_width(1.9);
  for (int i = 0; i < states; ++i) {
    v1::AgentState* state = agent.add_states();
    state->set_time(start + 0.1 * i);
    state->set_x(100.0 + speed * 0.1 * i);
    state->set_y(50.0);
  }
  return agent;
}

v1::Scenario Recording(v1::Agent agent) {
  v1::Scenario scenario;
  scenario.set_scenario_id("a-recording");
  *scenario.add_agents() = std::move(agent);
  return scenario;
}

void RemoveStates(v1::Agent* agent, int first, int count) {
  agent->mutable_states()->DeleteSubrange(first, count);
}

std::vector<Example> Enumerate(const v1::Scenario& recording) {
  return EnumerateExamples(recording, 3, Spec(), Settings());
}

std::vector<double> Times(const std::vector<Example>& examples) {
  std::vector<double> times;
  for (const Example& example : examples) times.push_back(example.time);
  return times;
}

MATCHER_P(TimesAre, expected, "") {
  return testing::ExplainMatchResult(Pointwise(DoubleNear(1e-6), expected), Times(arg),
                                     result_listener);
}

using Expected = std::vector<double>;

TEST(EnumerateExamplesTest, FindsEveryStrideWithItsPastAndItsFuture) {
  // 0 to 5 s: one second of past from 1.0 on, two of future up to 3.0.
  const auto examples = Enumerate(Recording(Vehicle(7, 0.0, 51, 10.0)));
  EXPECT_THAT(examples, TimesAre(Expected{1.0, 1.5, 2.0, 2.5, 3.0}));
  EXPECT_EQ(examples[0].recording, 3);
  EXPECT_EQ(examples[0].target_id, 7);
  EXPECT_FALSE(examples[0].standing);
}

TEST(EnumerateExamplesTest, TheTrajectoryIsInTheTargetsFrameAtItsTime) {
  v1::Agent agent = Vehicle(7, 0.0, 51, 0.0);
  // It drives along +y at 4 m/s and heads that way.
  for (int i = 0; i < agent.states_size(); ++i) {
    agent.mutable_states(i)->set_y(50.0 + 0.4 * i);
    agent.mutable_states(i)->set_heading(std::numbers::pi_v<float> / 2.0f);
  }
  const auto examples = Enumerate(Recording(agent));
  ASSERT_EQ(examples.size(), 5u);
  EXPECT_NEAR(examples[0].X_WT.x(), 100.0, 1e-9);
  EXPECT_NEAR(examples[0].X_WT.y(), 54.0, 1e-9);
  ASSERT_EQ(examples[0].trajectory.size(), 8u);
  for (int i = 0; i < 4; ++i) {
    EXPECT_NEAR(examples[0].trajectory[2 * i], 2.0 * (i + 1), 1e-5);
    EXPECT_NEAR(examples[0].trajectory[2 * i + 1], 0.0, 1e-5);
  }
}

TEST(EnumerateExamplesTest, TimesFollowTheScenariosClockWhereverATrackBegins) {
  // States from 0.3 to 5.3 s: the past is complete from 1.3 s on.
  EXPECT_THAT(Enumerate(Recording(Vehicle(7, 0.3, 51, 10.0))),
              TimesAre(Expected{1.5, 2.0, 2.5, 3.0}));
}

TEST(EnumerateExamplesTest, TimesAreThoseOfTheNearestState) {
  // The track's clock is 0.03 s off.
  EXPECT_THAT(Enumerate(Recording(Vehicle(7, 0.03, 51, 10.0))),
              TimesAre(Expected{1.03, 1.53, 2.03, 2.53, 3.03}));
}

TEST(EnumerateExamplesTest, AStrideShorterThanTheTracksStepUsesEachStateOnce) {
  v1::ExampleSettings settings = Settings();
  settings.mutable_stride()->set_nanos(20'000'000);
  const auto examples =
      EnumerateExamples(Recording(Vehicle(7, 0.0, 36, 10.0)), 0, Spec(), settings);
  EXPECT_THAT(examples, TimesAre(Expected{1.0, 1.1, 1.2, 1.3, 1.4, 1.5}));
}

TEST(EnumerateExamplesTest, LargeClocksWork) {
  const double epoch = 1.7e9;
  EXPECT_THAT(Enumerate(Recording(Vehicle(7, epoch, 51, 10.0))),
              TimesAre(Expected{epoch + 1.0, epoch + 1.5, epoch + 2.0, epoch + 2.5, epoch + 3.0}));
}

TEST(EnumerateExamplesTest, AGapOfThreeCenturiesTakesNoTime) {
  const double later = 1e10;
  v1::Agent agent = Vehicle(7, 0.0, 36, 10.0);
  agent.mutable_states()->MergeFrom(Vehicle(7, later, 36, 10.0).states());
  v1::ExampleSettings settings = Settings();
  settings.mutable_stride()->set_nanos(10'000'000);
  const auto examples = EnumerateExamples(Recording(agent), 0, Spec(), settings);
  Expected times;
  for (const double start : {0.0, later}) {
    for (int i = 10; i <= 15; ++i) times.push_back(start + 0.1 * i);
  }
  EXPECT_THAT(Times(examples), Pointwise(DoubleNear(1e-5), times));
}

TEST(EnumerateExamplesTest, WithoutAStrideThereAreNoExamples) {
  v1::ExampleSettings settings = Settings();
  settings.clear_stride();
  EXPECT_THAT(EnumerateExamples(Recording(Vehicle(7, 0.0, 51, 10.0)), 0, Spec(), settings),
              IsEmpty());
}

// Returns the targets with examples, among one agent of each type.
std::vector<int64_t> TargetsOf(const v1::ModelSpec& spec, v1::ExampleSettings settings,
                               double speed) {
  settings.mutable_stride()->set_seconds(10);  // and a half: one example per track
  v1::Scenario recording = Recording(Vehicle(v1::AGENT_TYPE_UNSPECIFIED, 8.0, 51, speed));
  for (const auto type : {v1::AGENT_TYPE_VEHICLE, v1::AGENT_TYPE_PEDESTRIAN, v1::AGENT_TYPE_CYCLIST,
                          v1::AGENT_TYPE_OTHER}) {
    *recording.add_agents() = Vehicle(type, 8.0, 51, speed);
  }
  for (v1::Agent& agent : *recording.mutable_agents()) {
    agent.set_type(static_cast<v1::AgentType>(agent.id()));
  }
  std::vector<int64_t> targets;
  for (const Example& example : EnumerateExamples(recording, 0, spec, settings)) {
    targets.push_back(example.target_id);
  }
  return targets;
}

TEST(EnumerateExamplesTest, OnlyTypesThatTheModelLearnsFromAreTargets) {
  v1::ModelSpec spec = Spec();
  EXPECT_THAT(TargetsOf(spec, Settings(), 5.0), ElementsAre(v1::AGENT_TYPE_VEHICLE));
  spec.add_target_types(v1::AGENT_TYPE_CYCLIST);
  EXPECT_THAT(TargetsOf(spec, Settings(), 5.0), ElementsAre(v1::AGENT_TYPE_CYCLIST));
  spec.add_target_types(v1::AGENT_TYPE_PEDESTRIAN);
  EXPECT_THAT(TargetsOf(spec, Settings(), 5.0),
              ElementsAre(v1::AGENT_TYPE_PEDESTRIAN, v1::AGENT_TYPE_CYCLIST));
}

v1::ModelSpec EveryType() {
  v1::ModelSpec spec = Spec();
  for (const auto type : {v1::AGENT_TYPE_VEHICLE, v1::AGENT_TYPE_PEDESTRIAN, v1::AGENT_TYPE_CYCLIST,
                          v1::AGENT_TYPE_OTHER}) {
    spec.add_target_types(type);
  }
  return spec;
}

TEST(EnumerateExamplesTest, LeavesOutATargetFasterThanItsTypeCanBe) {
  EXPECT_THAT(TargetsOf(EveryType(), Settings(), 11.0),
              ElementsAre(v1::AGENT_TYPE_VEHICLE, v1::AGENT_TYPE_CYCLIST, v1::AGENT_TYPE_OTHER));
  EXPECT_THAT(TargetsOf(EveryType(), Settings(), 26.0),
              ElementsAre(v1::AGENT_TYPE_VEHICLE, v1::AGENT_TYPE_OTHER));
  v1::ExampleSettings slow = Settings();
  slow.set_max_speed(4.0);
  EXPECT_THAT(TargetsOf(EveryType(), slow, 5.0), IsEmpty());
}

TEST(EnumerateExamplesTest, RequiresAStateAtTheOldestFrame) {
  v1::Agent agent = Vehicle(7, 0.0, 51, 10.0);
  RemoveStates(&agent, 0, 1);
  EXPECT_THAT(Enumerate(Recording(agent)), TimesAre(Expected{1.5, 2.0, 2.5, 3.0}));
}

TEST(EnumerateExamplesTest, AcceptsOneMissingFrameInPastOrFuture) {
  v1::Agent agent = Vehicle(7, 0.0, 51, 10.0);
  RemoveStates(&agent, 22, 1);
  EXPECT_THAT(Enumerate(Recording(agent)), TimesAre(Expected{1.0, 1.5, 2.0, 2.5, 3.0}));
}

TEST(EnumerateExamplesTest, LeavesOutAnExampleWithAGapInItsPast) {
  v1::Agent agent = Vehicle(7, 0.0, 51, 10.0);
  RemoveStates(&agent, 3, 2);  // 0.2 to 0.5: only within the past of 1.0
  EXPECT_THAT(Enumerate(Recording(agent)), TimesAre(Expected{1.5, 2.0, 2.5, 3.0}));
}

TEST(EnumerateExamplesTest, LeavesOutAnExampleWithAGapAtAWaypoint) {
  v1::Agent agent = Vehicle(7, 0.0, 51, 10.0);
  RemoveStates(&agent, 44, 3);  // none at 4.5: the waypoint of 2.5 and 3.0
  EXPECT_THAT(Enumerate(Recording(agent)), TimesAre(Expected{1.0, 1.5, 2.0}));
}

TEST(EnumerateExamplesTest, LeavesOutWindowsWithAJumpFasterThanMaxSpeed) {
  v1::Agent agent = Vehicle(7, 0.0, 91, 10.0);
  // From 4.0 on, 6 m to the side: 60 m/s and more over one step.
  for (int i = 40; i < agent.states_size(); ++i) agent.mutable_states(i)->set_y(56.0);
  // Windows reach 1 s back and 2 s ahead: 1.9 and earlier end before the jump, 5.0 begins after.
  EXPECT_THAT(Enumerate(Recording(agent)), TimesAre(Expected{1.0, 1.5, 5.0, 5.5, 6.0, 6.5, 7.0}));
  v1::ExampleSettings settings = Settings();
  settings.set_max_speed(0.0);
  EXPECT_EQ(EnumerateExamples(Recording(agent), 0, Spec(), settings).size(), 13u);
}

TEST(EnumerateExamplesTest, ATargetThatStaysWithinTheStandingDistanceStands) {
  const auto creeping = Enumerate(Recording(Vehicle(7, 0.0, 51, 0.49)));  // 0.98 m in 2 s
  ASSERT_EQ(creeping.size(), 5u);
  EXPECT_TRUE(creeping[0].standing);
  const auto moving = Enumerate(Recording(Vehicle(7, 0.0, 51, 0.51)));  // 1.02 m in 2 s
  ASSERT_EQ(moving.size(), 5u);
  EXPECT_FALSE(moving[0].standing);
}

TEST(EnumerateExamplesTest, SensorNoiseDoesNotMakeAStandingTargetMove) {
  v1::Agent agent = Vehicle(7, 0.0, 51, 0.0);
  for (int i = 0; i < agent.states_size(); ++i) {
    agent.mutable_states(i)->set_y(50.0 + (i % 2 == 0 ? 0.1 : -0.1));  // 4 m of path in 2 s
  }
  const auto examples = Enumerate(Recording(agent));
  ASSERT_EQ(examples.size(), 5u);
  EXPECT_TRUE(examples[0].standing);
}

// A recording of many standing vehicles, with five windows each.
v1::Scenario CarPark(const std::string& id, int vehicles) {
  v1::Scenario scenario;
  scenario.set_scenario_id(id);
  for (int i = 0; i < vehicles; ++i) *scenario.add_agents() = Vehicle(i + 1, 0.0, 51, 0.0);
  return scenario;
}

std::set<std::pair<int64_t, double>> Kept(const v1::Scenario& scenario, double share,
                                          int64_t* standing_seen = nullptr) {
  v1::ExampleSettings settings = Settings();
  settings.set_keep_standing(share);
  std::set<std::pair<int64_t, double>> kept;
  for (const Example& example : EnumerateExamples(scenario, 0, Spec(), settings, standing_seen)) {
    kept.emplace(example.target_id, example.time);
  }
  return kept;
}

TEST(KeepStandingTest, KeepsTheGivenShareAndCountsAll) {
  int64_t standing_seen = 0;
  const auto kept = Kept(CarPark("park", 400), 0.12, &standing_seen);
  EXPECT_EQ(standing_seen, 2000);
  // Binomial with mean 240 and standard deviation 14.5: five deviations.
  EXPECT_NEAR(static_cast<double>(kept.size()), 240.0, 73.0);
  EXPECT_EQ(Kept(CarPark("park", 400), 1.0).size(), 2000u);
}

TEST(KeepStandingTest, KeepsAllPedestriansAndCyclists) {
  v1::ExampleSettings few = Settings();
  few.set_keep_standing(1e-9);
  EXPECT_THAT(TargetsOf(EveryType(), few, 0.0),
              ElementsAre(v1::AGENT_TYPE_PEDESTRIAN, v1::AGENT_TYPE_CYCLIST));
}

TEST(KeepStandingTest, ALargerShareKeepsWhatASmallerOneKeeps) {
  const auto few = Kept(CarPark("park", 100), 0.1);
  const auto many = Kept(CarPark("park", 100), 0.5);
  EXPECT_LT(few.size(), many.size());
  for (const auto& window : few) EXPECT_TRUE(many.contains(window));
}

TEST(KeepStandingTest, DoesNotDependOnOtherAgents) {
  const auto alone = Kept(CarPark("park", 50), 0.3);
  const auto in_company = Kept(CarPark("park", 100), 0.3);
  for (const auto& window : alone) EXPECT_TRUE(in_company.contains(window));
}

TEST(KeepStandingTest, DiffersBetweenRecordings) {
  EXPECT_NE(Kept(CarPark("park", 50), 0.3), Kept(CarPark("another", 50), 0.3));
}

TEST(KeepStandingTest, NeverLeavesOutAMovingTarget) {
  v1::ExampleSettings settings = Settings();
  settings.set_keep_standing(1e-9);
  EXPECT_EQ(EnumerateExamples(Recording(Vehicle(7, 0.0, 51, 10.0)), 0, Spec(), settings).size(),
            5u);
}

// Published vectors: what is held out must never change between versions or machines.
TEST(StableHashTest, IsFnv1aAndSplitMix64) {
  EXPECT_EQ(StableHash(""), 0xCBF29CE484222325u);
  EXPECT_EQ(StableHash("a"), 0xAF63DC4C8601EC8Cu);
  EXPECT_EQ(StableHash("foobar"), 0x85944171F73967E8u);
  // The first output of SplitMix64 from the seed 0.
  EXPECT_EQ(MixHash(0, 0), 0xE220A8397B1DCDAFu);
  EXPECT_EQ(UnitInterval(0), 0.0);
  EXPECT_LT(UnitInterval(~uint64_t{0}), 1.0);
  EXPECT_EQ(UnitInterval(uint64_t{1} << 63), 0.5);
}

TEST(ExampleIndexTest, LeavesOutAVehicleThatIsPhysicallyImpossible) {
  v1::Scenario recording = Recording(Vehicle(1, 0.0, 40, 10.0));
  *recording.add_agents() = Vehicle(2, 0.0, 40, 10.0);
  const size_t of_both = Enumerate(recording).size();
  recording.mutable_agents(1)->mutable_states(12)->set_heading(3.4e38F);
  const std::vector<Example> examples = Enumerate(recording);
  EXPECT_EQ(examples.size(), of_both / 2);
  for (const Example& example : examples) EXPECT_EQ(example.target_id, 1);
}

}  // namespace
}  // namespace maneuver::data::example_index_test
