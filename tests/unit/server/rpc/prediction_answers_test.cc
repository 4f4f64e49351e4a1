#include "server/rpc/prediction_answers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/serving/answer_size.h"
#include "tests/unit/server/rpc/prediction_messages.h"

namespace maneuver::rpc::prediction_answers_test {
namespace {

using ::testing::ElementsAre;

class WritePredictionsTest : public ::testing::Test {
 protected:
  WritePredictionsTest() {
    *request_.add_scenarios() = TwoCars();
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

TEST_F(WritePredictionsTest, WarningsHaveTheirPathFromTheRequest) {
  plan_.scenarios[0].warnings = {{"agents[0].states[0].heading", "is 180"}};
  google::protobuf::RepeatedPtrField<v1::ScenarioPrediction> written;
  WritePredictions(request_.scenarios(), plan_, answers_, {}, &written);
  ASSERT_EQ(written[0].warnings_size(), 1);
  EXPECT_EQ(written[0].warnings(0).field(), "scenarios[0].agents[0].states[0].heading");
  EXPECT_EQ(written[0].warnings(0).description(), "is 180");
  EXPECT_EQ(written[0].targets(0).probabilities_size(), 3) << "it is answered";
}

// The memory for an answer is reserved before its warnings are known.
TEST_F(WritePredictionsTest, TheMostAndLongestWarningsFitIntoWhatAScenarioReserves) {
  v1::Scenario& scenario = *request_.mutable_scenarios(0);
  scenario.set_scenario_id(std::string(128, 's'));
  for (v1::Agent& agent : *scenario.mutable_agents()) {
    agent.set_length(999.999);
    v1::AgentState& state = *agent.mutable_states(0);
    state.set_time(5.0);
    state.set_x(-9.9999999e7);
    state.set_heading(-999.999F);
    state.set_velocity_x(-999.999F);
  }
  scenario.mutable_agents(0)->mutable_states(0)->set_time(4.0);
  *scenario.mutable_agents(0)->add_states() = scenario.agents(1).states(0);
  v1::MapFeature* lane = scenario.add_map_features();
  lane->set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  lane->add_x(9.9999999e7);
  lane->add_y(0);
  plan_ = PlanPrediction(request_.scenarios(), Spec(), {}, false);
  ASSERT_EQ(plan_.scenarios[0].warnings.size(), 8u);
  answers_.resize(plan_.targets.size(), answers_[0]);
  google::protobuf::RepeatedPtrField<v1::ScenarioPrediction> written;
  WritePredictions(request_.scenarios(), plan_, answers_, {}, &written);
  written[0].clear_targets();
  EXPECT_LT(static_cast<int64_t>(written[0].ByteSizeLong()), serving::kScenarioBytes);
}

TEST_F(WritePredictionsTest, TheTargetFrameIsTheFrameOfTheModel) {
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

// The first scenario is refused, and in the second the second target has no answer.
TEST_F(WritePredictionsTest, CombinationsComeWithTheirScenarioAndItsAnsweredTargets) {
  v1::Scenario scene = TwoCars();
  request_.mutable_scenarios(0)->mutable_agents(0)->set_length(-1.0);
  *request_.add_scenarios() = scene;
  *request_.add_scenarios() = scene;
  plan_ = PlanPrediction(request_.scenarios(), Spec(), {}, false);
  ASSERT_EQ(plan_.targets.size(), 2u);
  answers_.push_back(answers_[0]);
  const std::vector<serving::JointAnswer> joint = {
      {.targets = {}, .found = {.combinations = {}}},
      {.targets = {1},
       .found = {.combinations = {{.actions = {1}, .log_probability = -0.5, .weight = 0.75},
                                  {.actions = {2}, .log_probability = -1.5, .weight = 0.25}},
                 .truncated = true}}};
  google::protobuf::RepeatedPtrField<v1::ScenarioPrediction> written;
  WritePredictions(request_.scenarios(), plan_, answers_, {}, &written, joint);
  ASSERT_EQ(written.size(), 3);
  EXPECT_FALSE(written[0].has_joint());
  EXPECT_FALSE(written[1].has_joint());
  const v1::JointPrediction& second = written[2].joint();
  EXPECT_THAT(second.target_ids(), ElementsAre(1));
  ASSERT_EQ(second.combinations_size(), 2);
  EXPECT_THAT(second.combinations(0).action_ids(), ElementsAre(1));
  EXPECT_EQ(second.combinations(0).log_probability(), -0.5);
  EXPECT_EQ(second.combinations(1).weight(), 0.25);
  EXPECT_TRUE(second.truncated());
}

TEST_F(WritePredictionsTest, AFailedTargetHasOnlyItsError) {
  answers_[0] = {};
  answers_[0].status = absl::InternalError("no");
  const v1::TargetPrediction target = Write({});
  EXPECT_EQ(target.error().code(), 13);
  EXPECT_EQ(target.probabilities_size(), 0);
}

}  // namespace
}  // namespace maneuver::rpc::prediction_answers_test
