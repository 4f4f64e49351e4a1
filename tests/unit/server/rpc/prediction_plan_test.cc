#include "server/rpc/prediction_plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/server/rpc/prediction_messages.h"

namespace maneuver::rpc::prediction_plan_test {
namespace {

using ::testing::HasSubstr;

TEST(PlanPredictionTest, BadItemsFailAloneWithTheirPathFromTheRequest) {
  v1::PredictRequest request;
  *request.add_scenarios() = TwoCars();
  *request.add_scenarios() = TwoCars();
  request.mutable_scenarios(1)->mutable_agents(1)->mutable_states(0)->set_x(std::nan(""));
  request.add_scenarios();
  const PredictionPlan plan = PlanPrediction(request.scenarios(), Spec(), {}, false);

  ASSERT_EQ(plan.scenarios.size(), 3u);
  EXPECT_TRUE(plan.scenarios[0].status.ok());
  EXPECT_TRUE(plan.scenarios[0].targets[0].status.ok());
  EXPECT_EQ(FirstField(plan.scenarios[0].targets[1].status), "scenarios[0].target_ids[1]");
  EXPECT_EQ(FirstField(plan.scenarios[1].status), "scenarios[1].agents[1].states[0].x");
  EXPECT_EQ(FirstField(plan.scenarios[2].status), "scenarios[2].target_ids");
  ASSERT_EQ(plan.targets.size(), 1u);
  EXPECT_EQ(plan.targets[0].id, 1);
  EXPECT_EQ(plan.targets[0].scenario, &request.scenarios(0));
}

TEST(PlanPredictionTest, RefusesMoreTargetsThanCanBeCombined) {
  v1::PredictRequest request;
  *request.add_scenarios() = TwoCars();
  *request.add_scenarios() = TwoCars();
  v1::Scenario& many = *request.mutable_scenarios(1);
  many.clear_target_ids();
  for (int id = 101; id <= 109; ++id) {
    *many.add_agents() = many.agents(0);
    many.mutable_agents()->rbegin()->set_id(id);
    many.add_target_ids(id);
  }
  PredictionPlan plan =
      PlanPrediction(request.scenarios(), Spec(), {}, false, {}, false, {}, /*joint=*/true);
  EXPECT_TRUE(plan.scenarios[0].status.ok());
  EXPECT_EQ(FirstField(plan.scenarios[1].status), "scenarios[1].target_ids");
  EXPECT_THAT(plan.scenarios[1].status.message(), HasSubstr("at most 8 targets"));
  EXPECT_TRUE(PlanPrediction(request.scenarios(), Spec(), {}, false).scenarios[1].status.ok());
  many.mutable_target_ids()->RemoveLast();
  plan = PlanPrediction(request.scenarios(), Spec(), {}, false, {}, false, {}, /*joint=*/true);
  EXPECT_TRUE(plan.scenarios[1].status.ok());
}

TEST(PlanPredictionTest, ReportsAScenarioIdThatIsTooLongOnce) {
  v1::PredictRequest request;
  *request.add_scenarios() = TwoCars();
  request.mutable_scenarios(0)->set_scenario_id(std::string(129, 'x'));
  const PredictionPlan plan = PlanPrediction(request.scenarios(), Spec(), {}, false);
  EXPECT_EQ(plan.scenarios[0].status.message(),
            "scenarios[0].scenario_id: has 129 characters; at most 128 are accepted");
}

TEST(PlanPredictionTest, RefusesATargetOfATypeThatTheModelHasNotLearned) {
  v1::PredictRequest request;
  *request.add_scenarios() = TwoCars();
  request.mutable_scenarios(0)->mutable_agents(1)->mutable_states(0)->set_time(5.0);
  request.mutable_scenarios(0)->mutable_agents(1)->set_type(v1::AGENT_TYPE_PEDESTRIAN);
  PredictionPlan plan = PlanPrediction(request.scenarios(), Spec(), {}, false);
  EXPECT_TRUE(plan.scenarios[0].targets[0].status.ok());
  const absl::Status& refused = plan.scenarios[0].targets[1].status;
  EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(FirstField(refused), "scenarios[0].target_ids[1]");
  EXPECT_EQ(errors::ReasonOf(refused), "TARGET_TYPE_NOT_LEARNED");
  EXPECT_THAT(std::string(refused.message()), HasSubstr("is a pedestrian"));
  EXPECT_THAT(std::string(refused.message()), HasSubstr("vehicles"));
  ASSERT_EQ(plan.targets.size(), 1u);

  v1::ModelSpec pedestrians = Spec();
  pedestrians.add_target_types(v1::AGENT_TYPE_PEDESTRIAN);
  plan = PlanPrediction(request.scenarios(), pedestrians, {}, false);
  EXPECT_FALSE(plan.scenarios[0].targets[0].status.ok());
  EXPECT_TRUE(plan.scenarios[0].targets[1].status.ok());
}

TEST(PlanPredictionTest, AnswersASceneThatLooksWrongWithWarnings) {
  v1::PredictRequest request;
  *request.add_scenarios() = TwoCars();
  request.mutable_scenarios(0)->mutable_agents(0)->mutable_states(0)->set_heading(180.0F);
  const PredictionPlan plan = PlanPrediction(request.scenarios(), Spec(), {}, false);
  EXPECT_EQ(plan.targets.size(), 1u);
  ASSERT_EQ(plan.scenarios[0].warnings.size(), 1u);
  EXPECT_EQ(plan.scenarios[0].warnings[0].field, "agents[0].states[0].heading");
}

TEST(PlanPredictionTest, RefusesAStrictSceneThatLooksWrongAndNoOther) {
  v1::PredictRequest request;
  *request.add_scenarios() = TwoCars();
  *request.add_scenarios() = TwoCars();
  request.mutable_scenarios(1)->mutable_agents(0)->mutable_states(0)->set_heading(180.0F);
  const PredictionPlan plan =
      PlanPrediction(request.scenarios(), Spec(), {}, false, {}, /*strict=*/true);
  EXPECT_TRUE(plan.scenarios[0].status.ok());
  const absl::Status& refused = plan.scenarios[1].status;
  EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(FirstField(refused), "scenarios[1].agents[0].states[0].heading");
}

// A scene that names its map has no features of its own.
TEST(PlanPredictionTest, LooksForLanesOfSignalsOnTheMapThatTheSceneNames) {
  v1::Scenario road;
  v1::MapFeature* lane = road.add_map_features();
  lane->set_id(3);
  lane->set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  for (const double y : {0.0, 50.0}) lane->add_x(10), lane->add_y(y);
  v1::PredictRequest request;
  *request.add_scenarios() = TwoCars();
  request.mutable_scenarios(0)->set_map_id(std::string(64, 'a'));
  request.mutable_scenarios(0)->add_traffic_signals()->set_lane_id(3);
  scene::ScenarioLimits limits;
  limits.map_by_id = true;
  const ScenarioMaps maps = {std::make_shared<scene::RoadMap>(road.map_features())};
  PredictionPlan plan = PlanPrediction(request.scenarios(), Spec(), limits, false, maps);
  EXPECT_TRUE(plan.scenarios[0].warnings.empty());
  request.mutable_scenarios(0)->mutable_traffic_signals(0)->set_lane_id(99);
  plan = PlanPrediction(request.scenarios(), Spec(), limits, false, maps);
  ASSERT_EQ(plan.scenarios[0].warnings.size(), 1u);
  EXPECT_EQ(plan.scenarios[0].warnings[0].field, "traffic_signals[0].lane_id");
}

TEST(PlanPredictionTest, AnswersATargetWhoseTypeIsNotStated) {
  v1::PredictRequest request;
  *request.add_scenarios() = TwoCars();
  request.mutable_scenarios(0)->mutable_agents(0)->clear_type();
  const PredictionPlan plan = PlanPrediction(request.scenarios(), Spec(), {}, false);
  EXPECT_TRUE(plan.scenarios[0].targets[0].status.ok());
}

// Half of the default interval of 0.25 s.
TEST(PlanPredictionTest, AModelWithoutARasterAcceptsAStateAnEighthOfASecondOld) {
  v1::ModelSpec spec = Spec();
  spec.clear_raster();
  spec.mutable_scene_vectors()->set_history_width(8);
  v1::PredictRequest request;
  *request.add_scenarios() = TwoCars();
  v1::AgentState& state = *request.mutable_scenarios(0)->mutable_agents(0)->mutable_states(0);
  state.set_time(4.88);
  EXPECT_EQ(PlanPrediction(request.scenarios(), spec, {}, false).targets.size(), 1u);
  state.set_time(4.87);
  EXPECT_TRUE(PlanPrediction(request.scenarios(), spec, {}, false).targets.empty());
}

TEST(PlanPredictionTest, ATargetWhoseStateIsALittleOldHasGoneOn) {
  v1::ModelSpec spec = Spec();
  spec.clear_raster();
  spec.mutable_scene_vectors()->set_history_width(8);
  v1::PredictRequest request;
  *request.add_scenarios() = TwoCars();
  v1::AgentState& state = *request.mutable_scenarios(0)->mutable_agents(0)->mutable_states(0);
  state.set_time(4.9);
  state.set_velocity_y(20.0F);
  const auto y = [&](int version) {
    spec.set_inputs_version(version);
    return PlanPrediction(request.scenarios(), spec, {}, false).targets.at(0).X_WT.y();
  };
  EXPECT_NEAR(y(3), state.y() + 2.0, 1e-6);
  EXPECT_EQ(y(2), state.y());
}

TEST(PlanPredictionTest, RefusesToClassifyATargetWithoutItsFuture) {
  v1::ClassifyTrajectoriesRequest request;
  *request.add_scenarios() = TwoCars();
  request.mutable_scenarios(0)->mutable_target_ids()->Truncate(1);
  const PredictionPlan without = PlanPrediction(request.scenarios(), Spec(), {}, true);
  EXPECT_EQ(FirstField(without.scenarios[0].targets[0].status), "scenarios[0].agents[0].states");
  EXPECT_TRUE(without.targets.empty());

  // One metre a second along its heading, which is +y of the world and +x of the target.
  for (int i = 1; i <= 4; ++i) {
    v1::AgentState* state = request.mutable_scenarios(0)->mutable_agents(0)->add_states();
    state->set_time(5.0 + 0.5 * i);
    state->set_x(10.0);
    state->set_y(20.0 + 0.5 * i);
    state->set_heading(1.5707963f);
  }
  const PredictionPlan with = PlanPrediction(request.scenarios(), Spec(), {}, true);
  ASSERT_EQ(with.targets.size(), 1u);
  EXPECT_NEAR(with.targets[0].trajectory(0, 0), 1.0, 1e-6);
  EXPECT_NEAR(with.targets[0].trajectory(1, 0), 2.0, 1e-6);
  EXPECT_NEAR(with.targets[0].trajectory(1, 1), 0.0, 1e-6);
}

}  // namespace
}  // namespace maneuver::rpc::prediction_plan_test
