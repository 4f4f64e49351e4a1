#include "model/scene/scenario_validation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include "tests/unit/model/scene/scene_fixture.h"

namespace maneuver::scene::scenario_validation_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kTolerance = 0.05;

// Five agents with ten states each, a feature of each type, a signal.
v1::Scenario GoodScenario() {
  v1::Scenario scenario;
  scenario.set_scenario_id("good");
  scenario.set_prediction_time(0.9);
  scenario.add_target_ids(10);
  scenario.add_target_ids(12);
  for (int a = 0; a < 5; ++a) {
    v1::Agent* agent = AddAgent(&scenario, 10 + a, static_cast<v1::AgentType>(a), 4.5, 1.9);
    for (int i = 0; i < 10; ++i) AddState(agent, 0.1 * i, i, a, 0.3);
  }
  for (int type = 1; type <= 9; ++type) {
    AddFeature(&scenario, static_cast<v1::MapFeatureType>(type), {{0, 0}, {5, 0}, {5, 5}, {0, 5}})
        ->set_id(type);
  }
  v1::TrafficSignal* signal = scenario.add_traffic_signals();
  signal->set_lane_id(1);
  for (int i = 0; i < 4; ++i) {
    v1::TrafficSignalReading* reading = signal->add_readings();
    reading->set_time(i);
    reading->set_state(static_cast<v1::TrafficSignalState>(i));
  }
  return scenario;
}

std::vector<std::string> Fields(const std::vector<FieldViolation>& violations) {
  std::vector<std::string> fields;
  for (const FieldViolation& violation : violations) fields.push_back(violation.field);
  return fields;
}

TEST(ScenarioValidationTest, AcceptsAValidScenario) {
  EXPECT_THAT(Fields(ValidateScenario(GoodScenario(), {})), IsEmpty());
  EXPECT_THAT(Fields(ValidateScenario({}, {})), IsEmpty());
}

TEST(ScenarioValidationTest, AcceptsTheLargestDocumentedValues) {
  v1::Scenario scenario = GoodScenario();
  v1::AgentState* state = scenario.mutable_agents(3)->mutable_states(9);
  state->set_heading(-1000.0F);
  state->set_velocity_x(1000.0F);
  state->set_velocity_y(-1000.0F);
  state->set_x(1e8);
  state->set_time(1e11);
  scenario.set_prediction_time(1e11);
  scenario.mutable_map_features(0)->set_speed_limit(1000.0);
  EXPECT_THAT(Fields(ValidateScenario(scenario, {})), IsEmpty());
}

TEST(ScenarioValidationTest, AcceptsShortLinesAndAreas) {
  v1::Scenario scenario;
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, {{0, 0}});
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_CROSSWALK, {{0, 0}, {1, 1}});
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_STOP_SIGN, {{0, 0}});
  EXPECT_THAT(Fields(ValidateScenario(scenario, {})), IsEmpty());
}

TEST(ScenarioValidationTest, AMapIdReplacesAMapIfAllowed) {
  v1::Scenario scenario = GoodScenario();
  scenario.set_map_id("a");
  const ScenarioLimits by_id{.map_by_id = true};
  EXPECT_THAT(Fields(ValidateScenario(scenario, by_id)), ElementsAre("map_id"));
  scenario.clear_map_features();
  EXPECT_THAT(Fields(ValidateScenario(scenario, by_id)), IsEmpty());
  // In a dataset, the id cannot be looked up.
  EXPECT_THAT(Fields(ValidateScenario(scenario, {})), ElementsAre("map_id"));
}

TEST(ScenarioValidationTest, ChecksAMapOnItsOwnByTheSameRules) {
  v1::Scenario scenario = GoodScenario();
  EXPECT_THAT(Fields(ValidateMap(scenario.map_features(), {})), IsEmpty());
  EXPECT_THAT(Fields(ValidateMap(scenario.map_features(), {.max_map_features = 2})),
              ElementsAre("map_features"));
  scenario.mutable_map_features(2)->set_x(1, kNan);
  EXPECT_THAT(Fields(ValidateMap(scenario.map_features(), {})),
              ElementsAre("map_features[2].x[1]"));
}

TEST(ScenarioValidationTest, ChecksCoordinatesOfFeaturesOnEachSide) {
  for (const double bad : {1.1e8, -1.1e8, kInfinity, -kInfinity, kNan}) {
    v1::Scenario scenario = GoodScenario();
    scenario.mutable_map_features(8)->set_x(3, bad);
    scenario.mutable_map_features(8)->set_y(2, bad);
    EXPECT_THAT(Fields(ValidateScenario(scenario, {})),
                ElementsAre("map_features[8].x[3]", "map_features[8].y[2]"));
    scenario.mutable_map_features(8)->set_x(3, 0.0);
    EXPECT_THAT(Fields(ValidateScenario(scenario, {})), ElementsAre("map_features[8].y[2]"));
    scenario.mutable_map_features(8)->set_x(3, bad);
    scenario.mutable_map_features(8)->set_y(2, 1e8);
    EXPECT_THAT(Fields(ValidateScenario(scenario, {})), ElementsAre("map_features[8].x[3]"));
  }
}

TEST(ScenarioValidationTest, GivesTheBoxOfEachFeature) {
  v1::Scenario scenario = GoodScenario();
  scenario.mutable_map_features(4)->set_x(2, 7.0);
  std::vector<Box> boxes;
  EXPECT_THAT(Fields(ValidateScenario(scenario, {}, &boxes)), IsEmpty());
  ASSERT_EQ(boxes.size(), 9u);
  EXPECT_EQ(boxes[3].high_x, 5.0);
  EXPECT_EQ(boxes[4].high_x, 7.0);
  EXPECT_EQ(boxes[4].low_y, 0.0);
  const RoadMap map = RoadMap::Over(scenario.map_features(), boxes);
  EXPECT_EQ(map.boxes()[4].high_x, 7.0);
}

struct BadCase {
  std::string name;
  std::string field;
  std::string description;  // part of it
  std::function<void(v1::Scenario*)> spoil;
};

class BadScenarioTest : public testing::TestWithParam<BadCase> {};

TEST_P(BadScenarioTest, NamesTheField) {
  v1::Scenario scenario = GoodScenario();
  GetParam().spoil(&scenario);
  const std::vector<FieldViolation> violations = ValidateScenario(scenario, {});
  ASSERT_THAT(Fields(violations), ElementsAre(GetParam().field));
  EXPECT_THAT(violations[0].description, HasSubstr(GetParam().description));
}

v1::AgentState* State37(v1::Scenario* s) { return s->mutable_agents(3)->mutable_states(7); }

INSTANTIATE_TEST_SUITE_P(
    Each, BadScenarioTest,
    testing::Values(
        BadCase{"IdThatIsNotUtf8", "scenario_id", "is not UTF-8",
                [](auto* s) { s->set_scenario_id("town\xff"); }},
        BadCase{"LongId", "scenario_id", "129 characters; at most 128",
                [](auto* s) { s->set_scenario_id(std::string(129, 'x')); }},
        BadCase{"PredictionTime", "prediction_time", "nan; must be a finite number",
                [](auto* s) { s->set_prediction_time(kNan); }},
        BadCase{"StateX", "agents[3].states[7].x", "inf; must be a finite",
                [](auto* s) { State37(s)->set_x(kInfinity); }},
        BadCase{"StateXTooFar", "agents[3].states[7].x",
                "is 200000000 m; must lie within 100000000",
                [](auto* s) { State37(s)->set_x(2e8); }},
        BadCase{"StateY", "agents[3].states[7].y", "nan", [](auto* s) { State37(s)->set_y(kNan); }},
        BadCase{"StateHeading", "agents[3].states[7].heading", "nan",
                [](auto* s) { State37(s)->set_heading(NAN); }},
        BadCase{"StateVelocityX", "agents[3].states[7].velocity_x", "inf",
                [](auto* s) { State37(s)->set_velocity_x(-INFINITY); }},
        BadCase{"StateVelocityY", "agents[3].states[7].velocity_y", "nan",
                [](auto* s) { State37(s)->set_velocity_y(NAN); }},
        BadCase{"StateHeadingOfManyTurns", "agents[3].states[7].heading",
                "is -1001 rad; must lie within -1000 and 1000 rad",
                [](auto* s) { State37(s)->set_heading(-1001.0F); }},
        BadCase{"LargestHeading", "agents[3].states[7].heading", "must lie within -1000 and 1000",
                [](auto* s) { State37(s)->set_heading(3.4e38F); }},
        BadCase{"StateVelocityTooFast", "agents[3].states[7].velocity_x",
                "is 1001 m/s; must lie within -1000 and 1000 m/s",
                [](auto* s) { State37(s)->set_velocity_x(1001.0F); }},
        BadCase{"StateVelocityTooFastBackwards", "agents[3].states[7].velocity_y",
                "is -1001 m/s; must lie within -1000 and 1000 m/s",
                [](auto* s) { State37(s)->set_velocity_y(-1001.0F); }},
        BadCase{"TimeThatIsNoClocks", "agents[3].states[9].time",
                "is 200000000000 s; must lie within -100000000000 and 100000000000 s",
                [](auto* s) { s->mutable_agents(3)->mutable_states(9)->set_time(2e11); }},
        BadCase{"PredictionTimeThatIsNoClocks", "prediction_time",
                "is -200000000000 s; must lie within -100000000000 and ",
                [](auto* s) { s->set_prediction_time(-2e11); }},
        BadCase{"SpeedLimitTooFast", "map_features[1].speed_limit",
                "is 1001 m/s; must lie within 0 and 1000 m/s",
                [](auto* s) { s->mutable_map_features(1)->set_speed_limit(1001.0); }},
        BadCase{
            "Successors", "map_features[1].successor_ids", "65 elements; at most 64",
            [](auto* s) { s->mutable_map_features(1)->mutable_successor_ids()->Resize(65, 1); }},
        BadCase{"LeftNeighbors", "map_features[1].left_neighbor_ids", "65 elements; at most 64",
                [](auto* s) {
                  s->mutable_map_features(1)->mutable_left_neighbor_ids()->Resize(65, 1);
                }},
        BadCase{"RightNeighbors", "map_features[1].right_neighbor_ids", "65 elements; at most 64",
                [](auto* s) {
                  s->mutable_map_features(1)->mutable_right_neighbor_ids()->Resize(65, 1);
                }},
        BadCase{"LastStateTime", "agents[3].states[9].time", "inf",
                [](auto* s) { s->mutable_agents(3)->mutable_states(9)->set_time(kInfinity); }},
        BadCase{"StateTimeBackwards", "agents[2].states[9].time",
                "is 0.75 s, not after the 0.8 s before it",
                [](auto* s) { s->mutable_agents(2)->mutable_states(9)->set_time(0.75); }},
        BadCase{"StateTimeTwice", "agents[2].states[9].time", "must strictly increase",
                [](auto* s) {
                  s->mutable_agents(2)->mutable_states(9)->set_time(s->agents(2).states(8).time());
                }},
        BadCase{"NegativeLength", "agents[1].length", "is -1 m; must be greater than 0",
                [](auto* s) { s->mutable_agents(1)->set_length(-1); }},
        BadCase{"ZeroWidth", "agents[1].width", "is 0 m; must be greater than 0",
                [](auto* s) { s->mutable_agents(1)->set_width(0); }},
        BadCase{"NanWidth", "agents[1].width", "nan; must be a finite number",
                [](auto* s) { s->mutable_agents(1)->set_width(kNan); }},
        BadCase{"HugeLength", "agents[1].length", "at most 1000 m",
                [](auto* s) { s->mutable_agents(1)->set_length(1001); }},
        BadCase{"DuplicateId", "agents[4].id", "is 11, which is also the id of agents[1]",
                [](auto* s) { s->mutable_agents(4)->set_id(11); }},
        BadCase{"UnknownAgentType", "agents[0].type", "77 is not a known agent type",
                [](auto* s) { s->mutable_agents(0)->set_type(static_cast<v1::AgentType>(77)); }},
        BadCase{"FeatureX", "map_features[2].x[1]", "nan",
                [](auto* s) { s->mutable_map_features(2)->set_x(1, kNan); }},
        BadCase{"FeatureYTooFar", "map_features[8].y[3]", "must lie within",
                [](auto* s) { s->mutable_map_features(8)->set_y(3, -1.1e8); }},
        BadCase{"FeatureUnequal", "map_features[2].y", "has 3 elements, but x has 4",
                [](auto* s) { s->mutable_map_features(2)->mutable_y()->RemoveLast(); }},
        BadCase{"FeatureWithoutPoints", "map_features[2].x", "has no points",
                [](auto* s) {
                  s->mutable_map_features(2)->clear_x();
                  s->mutable_map_features(2)->clear_y();
                }},
        BadCase{"FeatureTypeUnspecified", "map_features[0].type", "is not stated",
                [](auto* s) { s->mutable_map_features(0)->clear_type(); }},
        BadCase{"FeatureTypeUnknown", "map_features[0].type", "10 is not a known map feature type",
                [](auto* s) {
                  s->mutable_map_features(0)->set_type(static_cast<v1::MapFeatureType>(10));
                }},
        BadCase{"SpeedLimitNegative", "map_features[0].speed_limit", "is -3 m/s",
                [](auto* s) { s->mutable_map_features(0)->set_speed_limit(-3); }},
        BadCase{"SpeedLimitNan", "map_features[0].speed_limit", "nan; must be a finite",
                [](auto* s) { s->mutable_map_features(0)->set_speed_limit(kNan); }},
        BadCase{"ReadingTime", "traffic_signals[0].readings[1].time",
                "is 0 s, not after the 0 s before it",
                [](auto* s) { s->mutable_traffic_signals(0)->mutable_readings(1)->set_time(0); }},
        BadCase{
            "ReadingTimeNan", "traffic_signals[0].readings[3].time", "nan",
            [](auto* s) { s->mutable_traffic_signals(0)->mutable_readings(3)->set_time(kNan); }},
        BadCase{"ReadingState", "traffic_signals[0].readings[2].state",
                "-1 is not a known traffic signal state",
                [](auto* s) {
                  s->mutable_traffic_signals(0)->mutable_readings(2)->set_state(
                      static_cast<v1::TrafficSignalState>(-1));
                }}),
    [](const auto& test) { return test.param.name; });

TEST(ScenarioValidationTest, CountsTheScenarioIdInCharacters) {
  v1::Scenario scenario;
  std::string id;
  for (int i = 0; i < 128; ++i) id += "ü";  // two bytes each
  scenario.set_scenario_id(id);
  EXPECT_THAT(Fields(ValidateScenario(scenario, {})), IsEmpty());
}

TEST(ScenarioValidationTest, RefusesOneMoreThanEachLimit) {
  const v1::Scenario good = GoodScenario();
  // Exactly what GoodScenario has.
  ScenarioLimits limits;
  limits.max_agents = 5;
  limits.max_states_per_agent = 10;
  limits.max_map_features = 9;
  limits.max_map_points = 36;
  limits.max_targets = 2;
  limits.max_traffic_signals = 1;
  limits.max_readings_per_signal = 4;
  EXPECT_THAT(Fields(ValidateScenario(good, limits)), IsEmpty());

  const auto fields_with = [&](int ScenarioLimits::*limit) {
    ScenarioLimits tighter = limits;
    tighter.*limit -= 1;
    return Fields(ValidateScenario(good, tighter));
  };
  EXPECT_THAT(fields_with(&ScenarioLimits::max_agents), ElementsAre("agents"));
  EXPECT_THAT(fields_with(&ScenarioLimits::max_map_features), ElementsAre("map_features"));
  EXPECT_THAT(fields_with(&ScenarioLimits::max_map_points), ElementsAre("map_features"));
  EXPECT_THAT(fields_with(&ScenarioLimits::max_targets), ElementsAre("target_ids"));
  EXPECT_THAT(fields_with(&ScenarioLimits::max_traffic_signals), ElementsAre("traffic_signals"));
  EXPECT_THAT(fields_with(&ScenarioLimits::max_readings_per_signal),
              ElementsAre("traffic_signals[0].readings"));
  EXPECT_THAT(fields_with(&ScenarioLimits::max_states_per_agent),
              ElementsAre("agents[0].states", "agents[1].states", "agents[2].states",
                          "agents[3].states", "agents[4].states"));
}

TEST(ScenarioValidationTest, CountsPointsByTheLongerOfXAndY) {
  v1::Scenario scenario;
  v1::MapFeature* feature = AddFeature(&scenario, v1::MAP_FEATURE_TYPE_ROAD_EDGE, {{0, 0}});
  for (int i = 0; i < 50; ++i) feature->add_y(0);
  ScenarioLimits limits;
  limits.max_map_points = 50;
  EXPECT_THAT(Fields(ValidateScenario(scenario, limits)), ElementsAre("map_features"));
}

TEST(ScenarioValidationTest, ReportsAllViolationsUpToALimit) {
  v1::Scenario scenario = GoodScenario();
  scenario.set_prediction_time(kNan);
  scenario.mutable_agents(0)->set_length(0);
  scenario.mutable_agents(0)->mutable_states(0)->set_x(kNan);
  scenario.mutable_map_features(3)->set_y(2, kNan);
  EXPECT_THAT(Fields(ValidateScenario(scenario, {})),
              ElementsAre("prediction_time", "agents[0].length", "agents[0].states[0].x",
                          "map_features[3].y[2]"));
  for (v1::AgentState& state : *scenario.mutable_agents(1)->mutable_states()) state.set_y(kNan);
  for (v1::AgentState& state : *scenario.mutable_agents(2)->mutable_states()) state.set_y(kNan);
  EXPECT_THAT(ValidateScenario(scenario, {}), SizeIs(ScenarioLimits().max_violations));
}

class TargetValidationTest : public testing::Test {
 protected:
  TargetValidationTest() {
    scenario_.set_prediction_time(1.0);
    v1::Agent* agent = AddAgent(&scenario_, 7, v1::AGENT_TYPE_VEHICLE, 4, 2);
    for (const double time : {0.3, 0.4, 1.02}) AddState(agent, time, 0, 0, 0);
    AddState(AddAgent(&scenario_, 8, v1::AGENT_TYPE_VEHICLE, 4, 2), 0.96, 0, 0, 0);
    AddState(AddAgent(&scenario_, 9, v1::AGENT_TYPE_VEHICLE, 4, 2), 1.5, 0, 0, 0);
    AddAgent(&scenario_, 10, v1::AGENT_TYPE_VEHICLE, 4, 2);
  }
  std::optional<FieldViolation> Validate(std::initializer_list<int64_t> ids) {
    scenario_.clear_target_ids();
    for (const int64_t id : ids) scenario_.add_target_ids(id);
    return ValidateTarget(scenario_, scenario_.target_ids_size() - 1, kTolerance);
  }

  v1::Scenario scenario_;
};

TEST_F(TargetValidationTest, AcceptsATargetWithAStateNow) {
  EXPECT_FALSE(Validate({8}).has_value());
  EXPECT_FALSE(Validate({7, 9, 8}).has_value());
}

TEST_F(TargetValidationTest, NamesAnUnknownTarget) {
  const auto violation = Validate({8, 99});
  ASSERT_TRUE(violation.has_value());
  EXPECT_EQ(violation->field, "target_ids[1]");
  EXPECT_EQ(violation->description, "no agent has the id 99");
}

TEST_F(TargetValidationTest, NamesTheNearestStateIfThereIsNoneNow) {
  const auto violation = Validate({7});
  ASSERT_TRUE(violation.has_value());
  EXPECT_EQ(violation->field, "target_ids[0]");
  EXPECT_EQ(
      violation->description,
      "agent 7 has no state within 0.05 s before the prediction time, 1 s; its nearest state is at "
      "0.4 s");
}

TEST_F(TargetValidationTest, RefusesATargetThatAppearsLaterOrNever) {
  EXPECT_THAT(Validate({9})->description, HasSubstr("its first state is later, at 1.5 s"));
  EXPECT_THAT(Validate({10})->description, HasSubstr("it has no state at all"));
}

TEST_F(TargetValidationTest, RefusesTheSecondOfTwoEqualTargets) {
  const auto violation = Validate({8, 7, 8});
  ASSERT_TRUE(violation.has_value());
  EXPECT_EQ(violation->field, "target_ids[2]");
  EXPECT_THAT(violation->description, HasSubstr("is 8, as is target_ids[0]"));
  EXPECT_FALSE(ValidateTarget(scenario_, 0, kTolerance).has_value());
}

}  // namespace
}  // namespace maneuver::scene::scenario_validation_test
