#include "model/scene/scene_warnings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "model/scene/scenario_validation.h"
#include "tests/unit/model/scene/scene_fixture.h"

namespace maneuver::scene::scene_warnings_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kTolerance = 0.05;

// Sets the velocity of each state along its heading.
void Drive(v1::Agent* agent, double speed) {
  for (v1::AgentState& state : *agent->mutable_states()) {
    state.set_velocity_x(static_cast<float>(speed * std::cos(state.heading())));
    state.set_velocity_y(static_cast<float>(speed * std::sin(state.heading())));
  }
}

// A target at 10 m/s along +y and a cyclist at 5 m/s along +x, on a lane from (0, 0) to (0, 200)
// with a signal. The prediction time is 1 s, and a state follows it.
class SceneWarningsTest : public ::testing::Test {
 protected:
  SceneWarningsTest() {
    scenario_.set_prediction_time(1.0);
    scenario_.add_target_ids(7);
    target_ = AddAgent(&scenario_, 7, v1::AGENT_TYPE_VEHICLE, 4.5, 1.9);
    for (int i = 0; i <= 11; ++i) AddState(target_, 0.1 * i, 0, 10 + i, std::acos(0.0));
    Drive(target_, 10.0);
    other_ = AddAgent(&scenario_, 8, v1::AGENT_TYPE_CYCLIST, 1.8, 0.6);
    for (int i = 0; i <= 10; ++i) AddState(other_, 0.1 * i, 5 + 0.5 * i, 20, 0);
    Drive(other_, 5.0);
    AddFeature(&scenario_, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, {{0, 0}, {0, 200}})->set_id(3);
    AddFeature(&scenario_, v1::MAP_FEATURE_TYPE_ROAD_EDGE, {{4, 0}, {4, 200}})->set_id(4);
    scenario_.add_traffic_signals()->set_lane_id(3);
  }

  std::vector<FieldViolation> Find() {
    EXPECT_THAT(ValidateScenario(scenario_, {}), IsEmpty());
    return FindSceneWarnings(scenario_, RoadMap::Over(scenario_.map_features()), kTolerance);
  }
  // Returns the fields that are warned about.
  std::vector<std::string> Fields() {
    std::vector<std::string> fields;
    for (const FieldViolation& warning : Find()) fields.push_back(warning.field);
    return fields;
  }
  // Returns the target's state at the prediction time.
  v1::AgentState* Now() { return target_->mutable_states(10); }

  v1::Scenario scenario_;
  v1::Agent* target_;
  v1::Agent* other_;
};

TEST_F(SceneWarningsTest, FindsNothingInASceneThatLooksRight) { EXPECT_THAT(Fields(), IsEmpty()); }

TEST_F(SceneWarningsTest, WarnsOfDegreesInPlaceOfRadians) {
  for (v1::AgentState& state : *other_->mutable_states()) state.set_heading(180.0F);
  EXPECT_THAT(Fields(), ElementsAre("agents[1].states[10].heading"));
  EXPECT_THAT(Find()[0].description, HasSubstr("agent 8 has a heading of 180 rad"));
}

TEST_F(SceneWarningsTest, AllowsHeadingsThatCountAWholeTurn) {
  for (v1::AgentState& state : *target_->mutable_states()) {
    state.set_heading(state.heading() + static_cast<float>(4.0 * std::acos(0.0)));
  }
  EXPECT_THAT(Fields(), IsEmpty());
}

// 9 degrees are no more radians than a heading may have. The car then drives sideways.
TEST_F(SceneWarningsTest, WarnsOfATargetThatDrivesSideways) {
  Now()->set_heading(9.0F);
  EXPECT_THAT(Fields(), ElementsAre("agents[0].states[10].heading"));
  // The angle between 9 rad and pi / 2, modulo a turn: 9 - pi / 2 - 2 pi = 1.146 rad.
  EXPECT_THAT(Find()[0].description, HasSubstr("66 degrees off its heading of 9 rad"));
  target_->set_type(v1::AGENT_TYPE_PEDESTRIAN);
  EXPECT_THAT(Fields(), IsEmpty()) << "people walk sideways";
}

TEST_F(SceneWarningsTest, AllowsReversingAtLowSpeed) {
  for (v1::AgentState& state : *target_->mutable_states()) state.set_heading(-state.heading());
  EXPECT_THAT(Fields(), IsEmpty()) << "10 m/s backwards";
  for (int i = 0; i <= 11; ++i) target_->mutable_states(i)->set_y(10 + 2 * i);
  for (v1::AgentState& state : *target_->mutable_states()) state.set_velocity_y(20.0F);
  EXPECT_THAT(Fields(), ElementsAre("agents[0].states[10].heading")) << "20 m/s backwards";
}

TEST_F(SceneWarningsTest, WarnsOfSpeedsThatTheTypeDoesNotReach) {
  for (int i = 0; i <= 10; ++i) other_->mutable_states(i)->set_velocity_x(-40.0F);
  EXPECT_THAT(Fields(), ElementsAre("agents[1].states[10].velocity_x"));
  other_->set_type(v1::AGENT_TYPE_VEHICLE);
  EXPECT_THAT(Fields(), IsEmpty());
  other_->mutable_states(10)->set_velocity_y(500.0F);
  EXPECT_THAT(Fields(), ElementsAre("agents[1].states[10].velocity_y"));
}

TEST_F(SceneWarningsTest, WarnsOfATargetsVelocityThatItsPositionsContradict) {
  Drive(target_, 36.0);  // km/h
  EXPECT_THAT(Fields(), ElementsAre("agents[0].states[10].velocity_y"));
  EXPECT_THAT(Find()[0].description, HasSubstr("a velocity of (-0.0, 36.0) m/s"));
  EXPECT_THAT(Find()[0].description, HasSubstr("move at (0.0, 10.0) m/s"));
  Drive(target_, 0.0);  // left out
  EXPECT_THAT(Fields(), ElementsAre("agents[0].states[10].velocity_y"));
  Drive(target_, 13.0);
  EXPECT_THAT(Fields(), IsEmpty()) << "tracks are noisy";
}

TEST_F(SceneWarningsTest, ReadsNothingAfterThePredictionTime) {
  v1::AgentState* later = target_->mutable_states(11);
  later->set_heading(180.0F);
  later->set_velocity_x(500.0F);
  later->set_x(1e6);
  EXPECT_THAT(Fields(), IsEmpty());
}

TEST_F(SceneWarningsTest, WarnsOfMillisecondsInPlaceOfSeconds) {
  for (v1::AgentState& state : *target_->mutable_states()) state.set_time(1000.0 * state.time());
  scenario_.set_prediction_time(1000.0);
  EXPECT_THAT(Fields(), ElementsAre("agents[0].states[10].time"));
}

TEST_F(SceneWarningsTest, WarnsOfAgentsFarFromTheMap) {
  for (v1::AgentState& state : *target_->mutable_states()) state.set_x(4 + 99.0);
  EXPECT_THAT(Fields(), IsEmpty());
  for (v1::AgentState& state : *target_->mutable_states()) state.set_x(4 + 101.0);
  EXPECT_THAT(Fields(), ElementsAre("agents[0].states[10].x"));
  for (v1::AgentState& state : *target_->mutable_states()) state.set_x(0);
  for (v1::AgentState& state : *other_->mutable_states()) state.set_x(-900.0);
  EXPECT_THAT(Fields(), IsEmpty()) << "sensors see further than maps are cut";
  for (v1::AgentState& state : *other_->mutable_states()) state.set_x(-1100.0);
  EXPECT_THAT(Fields(), ElementsAre("agents[1].states[10].x"));
  scenario_.clear_map_features();
  scenario_.clear_traffic_signals();
  EXPECT_THAT(Fields(), IsEmpty()) << "no map, nothing far from it";
}

// The box around the whole map holds the target; those of its features do not.
TEST_F(SceneWarningsTest, ATargetBetweenTwoRoadsFarApartIsFarFromTheMap) {
  AddFeature(&scenario_, v1::MAP_FEATURE_TYPE_ROAD_EDGE, {{900, 0}, {900, 200}});
  for (v1::AgentState& state : *target_->mutable_states()) state.set_x(450.0);
  EXPECT_THAT(Fields(), ElementsAre("agents[0].states[10].x"));
  EXPECT_THAT(Find()[0].description, HasSubstr("446 m away"));
}

TEST_F(SceneWarningsTest, WarnsOnceOfSignalsWhoseLaneIsNotThere) {
  scenario_.add_traffic_signals()->set_lane_id(4);  // the road edge
  scenario_.add_traffic_signals()->set_lane_id(99);
  scenario_.add_traffic_signals()->set_lane_id(3);
  EXPECT_THAT(Fields(), ElementsAre("traffic_signals[1].lane_id"));
  EXPECT_THAT(Find()[0].description, HasSubstr("no lane 4, nor those of 1 more signals"));
}

TEST_F(SceneWarningsTest, WarnsOfSizesInOtherUnits) {
  target_->set_length(450.0);
  other_->set_width(60.0);
  EXPECT_THAT(Fields(), ElementsAre("agents[0].length", "agents[1].width"));
}

TEST_F(SceneWarningsTest, WarnsOfAVehicleWhoseLengthAndWidthAreSwapped) {
  v1::Agent& vehicle = *scenario_.mutable_agents(0);
  ASSERT_EQ(vehicle.type(), v1::AGENT_TYPE_VEHICLE);
  vehicle.set_length(1.9f);
  vehicle.set_width(4.5f);
  EXPECT_THAT(Fields(), ElementsAre("agents[0].width"));
  vehicle.set_width(3.0f);
  EXPECT_THAT(Fields(), IsEmpty());
  vehicle.set_width(4.5f);
  vehicle.set_type(v1::AGENT_TYPE_OTHER);
  EXPECT_THAT(Fields(), IsEmpty());
}

TEST_F(SceneWarningsTest, StopsAfterEightWarnings) {
  for (int i = 0; i < 20; ++i) {
    AddState(AddAgent(&scenario_, 100 + i, v1::AGENT_TYPE_VEHICLE, 4, 2), 1.0, 0, 0, 90.0);
  }
  EXPECT_THAT(Find(), SizeIs(8));
}

}  // namespace
}  // namespace maneuver::scene::scene_warnings_test
