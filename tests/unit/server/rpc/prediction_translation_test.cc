#include "server/rpc/prediction_translation.h"

#include <gmock/gmock.h>
#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "maneuver/v1/status.pb.h"
#include "server/errors/error_details.h"

namespace maneuver::rpc {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

template <typename Message>
Message FromText(const std::string& text) {
  Message message;
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(text, &message));
  return message;
}

v1::ModelSpec Spec() {
  return FromText<v1::ModelSpec>(R"(
    raster { height: 32 width: 32 meters_per_pixel: 1 target_position: 0.5 history_frames: 2
             frame_interval { nanos: 100000000 } }
    trajectory { waypoints: 2 waypoint_interval { seconds: 1 } }
    actions: 3)");
}

// Two cars: 1 stands at (10, 20) and looks along +y, 2 has no state now.
v1::Scenario Scene() {
  return FromText<v1::Scenario>(R"(
    scenario_id: "scene" prediction_time: 5 target_ids: [ 1, 2 ]
    agents { id: 1 type: AGENT_TYPE_VEHICLE length: 4 width: 2
             states { time: 5 x: 10 y: 20 heading: 1.5707963 } }
    agents { id: 2 type: AGENT_TYPE_VEHICLE length: 4 width: 2 states { time: 3 } })");
}

std::string FirstField(const absl::Status& status) {
  const v1::Status proto = errors::ToProto(status);
  for (const auto& any : proto.details()) {
    v1::BadRequest detail;
    if (any.type_url() == "type.googleapis.com/google.rpc.BadRequest" &&
        detail.ParseFromString(any.value())) {
      return detail.field_violations(0).field();
    }
  }
  return "";
}

TEST(PlanPredictionTest, BadItemsFailAloneWithTheirPathFromTheRequest) {
  v1::PredictRequest request;
  *request.add_scenarios() = Scene();
  *request.add_scenarios() = Scene();
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

TEST(PlanPredictionTest, RefusesATargetOfATypeThatTheModelHasNotLearned) {
  v1::PredictRequest request;
  *request.add_scenarios() = Scene();
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

TEST(PlanPredictionTest, AnswersATargetWhoseTypeIsNotStated) {
  v1::PredictRequest request;
  *request.add_scenarios() = Scene();
  request.mutable_scenarios(0)->mutable_agents(0)->clear_type();
  const PredictionPlan plan = PlanPrediction(request.scenarios(), Spec(), {}, false);
  EXPECT_TRUE(plan.scenarios[0].targets[0].status.ok());
}

// Half of the default interval of 0.25 s.
TEST(PlanPredictionTest, AModelWithoutARasterAllowsAStateOfAnEighthOfASecondAgo) {
  v1::ModelSpec spec = Spec();
  spec.clear_raster();
  spec.mutable_scene_vectors()->set_history_width(8);
  v1::PredictRequest request;
  *request.add_scenarios() = Scene();
  v1::AgentState& state = *request.mutable_scenarios(0)->mutable_agents(0)->mutable_states(0);
  state.set_time(4.88);
  EXPECT_EQ(PlanPrediction(request.scenarios(), spec, {}, false).targets.size(), 1u);
  state.set_time(4.87);
  EXPECT_TRUE(PlanPrediction(request.scenarios(), spec, {}, false).targets.empty());
}

TEST(PlanPredictionTest, ATargetWithoutItsFutureCannotBeClassified) {
  v1::ClassifyTrajectoriesRequest request;
  *request.add_scenarios() = Scene();
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

class WritePredictionsTest : public ::testing::Test {
 protected:
  WritePredictionsTest() {
    *request_.add_scenarios() = Scene();
    plan_ = PlanPrediction(request_.scenarios(), Spec(), {}, false);
    answers_.resize(1);
    answers_[0].encoding.probabilities = Eigen::Vector3d(0.1, 0.7, 0.2);
    inference::ActionDistribution action;
    action.action = 1;
    action.latent_mean = Eigen::VectorXd::Constant(1, 0.5);
    action.latent_stddev = Eigen::VectorXd::Constant(1, 2.0);
    inference::Trajectory ahead(1, 2);
    ahead << 3.0, 1.0;  // three metres ahead, one to the left
    action.sigma = {ahead, ahead, ahead};
    action.moment_mean = ahead;
    action.moment_covariance.resize(1, 3);
    action.moment_covariance << 4.0, 0.5, 1.0;
    answers_[0].distributions.push_back(action);
  }

  v1::TargetPrediction Write(const AnswerStyle& style) {
    google::protobuf::RepeatedPtrField<v1::ScenarioPrediction> written;
    WritePredictions(request_.scenarios(), plan_, answers_, style, &written);
    EXPECT_EQ(written.size(), 1);
    EXPECT_EQ(written[0].targets_size(), 2);
    EXPECT_EQ(written[0].scenario_id(), "scene");
    EXPECT_EQ(written[0].targets(1).error().code(), 3);
    return written[0].targets(0);
  }

  v1::PredictRequest request_;
  PredictionPlan plan_;
  std::vector<serving::TargetAnswer> answers_;
};

TEST_F(WritePredictionsTest, TheWorldFrameTurnsPositionsAndCovariances) {
  const v1::TargetPrediction target = Write({});
  EXPECT_THAT(target.probabilities(), ElementsAre(0.1, 0.7, 0.2));
  const v1::ActionDistribution& action = target.distributions(0);
  EXPECT_EQ(action.probability(), 0.7);
  EXPECT_EQ(action.sigma_trajectories_size(), 3);
  // A quarter turn to the left at (10, 20): ahead is +y, left is -x.
  EXPECT_NEAR(action.mean_trajectory().x(0), 10.0 - 1.0, 1e-6);
  EXPECT_NEAR(action.mean_trajectory().y(0), 20.0 + 3.0, 1e-6);
  EXPECT_NEAR(action.moments().mean_x(0), 9.0, 1e-6);
  // x' = -y, y' = x: xx' = yy, yy' = xx, xy' = -xy.
  EXPECT_NEAR(action.moments().covariance_xx(0), 1.0, 1e-6);
  EXPECT_NEAR(action.moments().covariance_xy(0), -0.5, 1e-6);
  EXPECT_NEAR(action.moments().covariance_yy(0), 4.0, 1e-6);
}

// They are turned several at a time, and there may be any number of them.
TEST_F(WritePredictionsTest, EachWaypointOfAnyNumberIsTurned) {
  for (int waypoints = 1; waypoints <= 13; ++waypoints) {
    inference::Trajectory path(waypoints, 2);
    for (int t = 0; t < waypoints; ++t) path.row(t) << 3.0 * t, 100.0 + t;
    inference::ActionDistribution& action = answers_[0].distributions[0];
    action.sigma = {path, 2.0 * path};
    action.moment_mean = path;
    action.moment_covariance.setZero(waypoints, 3);
    const v1::TargetPrediction target = Write({});
    const v1::Trajectory& second = target.distributions(0).sigma_trajectories(1);
    ASSERT_EQ(second.x_size(), waypoints);
    ASSERT_EQ(second.y_size(), waypoints);
    for (int t = 0; t < waypoints; ++t) {
      EXPECT_NEAR(second.x(t), 10.0 - 2.0 * (100.0 + t), 1e-4) << t << " of " << waypoints;
      EXPECT_NEAR(second.y(t), 20.0 + 2.0 * (3.0 * t), 1e-4) << t << " of " << waypoints;
    }
  }
}

TEST_F(WritePredictionsTest, TheTargetFrameIsTheModelsOwn) {
  const v1::TargetPrediction target =
      Write({.probabilities = false, .sigma_trajectories = false, .frame = v1::FRAME_TARGET});
  EXPECT_EQ(target.probabilities_size(), 0);
  const v1::ActionDistribution& action = target.distributions(0);
  EXPECT_EQ(action.sigma_trajectories_size(), 0);
  EXPECT_EQ(action.mean_trajectory().x(0), 3.0);
  EXPECT_EQ(action.moments().covariance_xx(0), 4.0);
  EXPECT_EQ(action.moments().covariance_xy(0), 0.5);
}

TEST_F(WritePredictionsTest, RepresentativesKeepTheirOrder) {
  EXPECT_EQ(Write({}).representatives_size(), 0);
  answers_[0].representatives = {{.action = 2, .weight = 0.25}, {.action = 1, .weight = 0.75}};
  const v1::TargetPrediction target = Write({});
  ASSERT_EQ(target.representatives_size(), 2);
  EXPECT_EQ(target.representatives(0).action_id(), 2);
  EXPECT_EQ(target.representatives(0).weight(), 0.25);
  EXPECT_EQ(target.representatives(1).action_id(), 1);
}

TEST_F(WritePredictionsTest, ATargetThatFailedLaterHasNothingButItsError) {
  answers_[0] = {};
  answers_[0].status = absl::InternalError("no");
  const v1::TargetPrediction target = Write({});
  EXPECT_EQ(target.error().code(), 13);
  EXPECT_EQ(target.probabilities_size(), 0);
}

TEST(ParseQueryTest, TheDefaultIsEveryActionOfAtLeastFivePercentFromThePosterior) {
  const auto describe = ParseQuery({}, 3);
  ASSERT_TRUE(describe.ok());
  EXPECT_EQ(std::get<serving::AtLeast>(describe->selection).probability, 0.05);
  EXPECT_EQ(describe->source, inference::LatentSource::kPosterior);
  EXPECT_EQ(describe->representatives, 0);
}

TEST(ParseQueryTest, RepresentativesGoWithAnySelection) {
  const auto describe =
      ParseQuery(FromText<v1::DistributionQuery>("top_k: 2 representatives: 3"), 3);
  ASSERT_TRUE(describe.ok());
  EXPECT_EQ(std::get<serving::TopK>(describe->selection).k, 2);
  EXPECT_EQ(describe->representatives, 3);
}

TEST(ParseQueryTest, WhatIsWrongIsNamed) {
  const auto field = [](const std::string& text) {
    const auto describe = ParseQuery(FromText<v1::DistributionQuery>(text), 3);
    return describe.ok() ? "" : FirstField(describe.status());
  };
  EXPECT_EQ(field("action_ids { ids: [ 2, 0 ] }"), "");
  EXPECT_EQ(field("action_ids { ids: [ 0, 3 ] }"), "query.action_ids.ids[1]");
  EXPECT_EQ(field("action_ids { ids: -1 }"), "query.action_ids.ids[0]");
  EXPECT_EQ(field("action_ids { ids: [ 1, 1 ] }"), "query.action_ids.ids[1]");
  EXPECT_EQ(field("action_ids { }"), "query.action_ids.ids");
  EXPECT_EQ(field("min_probability: 0"), "");
  EXPECT_EQ(field("min_probability: 1.1"), "query.min_probability");
  EXPECT_EQ(field("min_probability: nan"), "query.min_probability");
  EXPECT_EQ(field("top_k: 0"), "query.top_k");
  EXPECT_EQ(field("representatives: 4"), "query.representatives");
  EXPECT_EQ(field("representatives: -1"), "query.representatives");
  EXPECT_EQ(field("source: LATENT_SOURCE_PRIOR frame: FRAME_TARGET"), "");
  v1::DistributionQuery unknown;
  unknown.set_source(static_cast<v1::LatentSource>(9));
  EXPECT_EQ(FirstField(ParseQuery(unknown, 3).status()), "query.source");
  unknown.clear_source();
  unknown.set_frame(static_cast<v1::Frame>(9));
  EXPECT_EQ(FirstField(ParseQuery(unknown, 3).status()), "query.frame");
}

}  // namespace
}  // namespace maneuver::rpc
