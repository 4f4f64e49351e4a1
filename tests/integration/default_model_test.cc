// Tests a model of the default preset, which reads lane paths and agents as vectors and predicts
// relative to the present motion, with real processes: training through the Train RPC, and answers.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <memory>
#include <numeric>

#include "client/client.h"
#include "client/error_details.h"
#include "client/map_reuse.h"
#include "client/observed_scenario.h"
#include "tests/integration/trained_server.h"

namespace maneuver::integration::default_model_test {
namespace {

using ::testing::HasSubstr;

// Asks one server, which all tests share, in f32: answers have the same bits in any batch.
class DefaultModelTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    trained_ = std::make_unique<TrainedServer>(std::vector<std::string>{"--precision", "f32"},
                                               kTinyLanesSettings);
  }
  static void TearDownTestSuite() { trained_.reset(); }

  static std::unique_ptr<client::Client> Connect() {
    return *client::Client::Connect({.address = trained_->server().address()});
  }
  static v1::PredictRequest Request() {
    v1::PredictRequest request;
    request.set_model("models/tiny");
    for (const v1::Scenario& scenario : trained_->unseen()) {
      *request.add_scenarios() = scenario;
      client::StripFuture(request.mutable_scenarios(request.scenarios_size() - 1));
    }
    return request;
  }

  static std::unique_ptr<TrainedServer> trained_;
};

std::unique_ptr<TrainedServer> DefaultModelTest::trained_;

TEST_F(DefaultModelTest, AnswersHaveTheSameBitsInABatchAloneAndWithRegisteredMaps) {
  const auto client = Connect();
  const v1::PredictRequest request = Request();
  const auto whole = client->Predict(request);
  ASSERT_TRUE(whole.ok()) << whole.status();
  client::MapReuse maps(*client);
  const auto named = maps.Predict(request);
  ASSERT_TRUE(named.ok()) << named.status();
  EXPECT_TRUE(named->SerializeAsString() == whole->SerializeAsString());
  for (int i = 0; i < request.scenarios_size(); ++i) {
    v1::PredictRequest alone = request;
    alone.clear_scenarios();
    *alone.add_scenarios() = request.scenarios(i);
    const auto answer = client->Predict(alone);
    ASSERT_TRUE(answer.ok()) << answer.status();
    ASSERT_FALSE(answer->predictions(0).has_error()) << answer->predictions(0).error().message();
    v1::ScenarioPrediction in_batch = whole->predictions(i);
    in_batch.set_scenario_index(0);
    EXPECT_TRUE(answer->predictions(0).SerializeAsString() == in_batch.SerializeAsString()) << i;
  }
}

TEST_F(DefaultModelTest, ProbabilitiesAndWeightsOfRepresentativesSumToOne) {
  const auto client = Connect();
  v1::PredictRequest request = Request();
  request.mutable_query()->set_representatives(3);
  const auto answer = client->Predict(request);
  ASSERT_TRUE(answer.ok()) << answer.status();
  for (const v1::ScenarioPrediction& prediction : answer->predictions()) {
    for (const v1::TargetPrediction& target : prediction.targets()) {
      ASSERT_EQ(target.probabilities_size(), 12);
      EXPECT_NEAR(
          std::accumulate(target.probabilities().begin(), target.probabilities().end(), 0.0), 1.0,
          1e-5);
      ASSERT_EQ(target.representatives_size(), 3);
      double weights = 0.0;
      for (const auto& representative : target.representatives()) {
        weights += representative.weight();
      }
      EXPECT_NEAR(weights, 1.0, 1e-5);
    }
  }
}

// The lanes matter: without its map, a scene has another answer.
TEST_F(DefaultModelTest, AnAnswerDependsOnTheMap) {
  const auto client = Connect();
  v1::PredictRequest request = Request();
  request.mutable_scenarios()->DeleteSubrange(1, request.scenarios_size() - 1);
  const auto with = client->Predict(request);
  request.mutable_scenarios(0)->clear_map_features();
  const auto without = client->Predict(request);
  ASSERT_TRUE(with.ok() && without.ok()) << with.status() << without.status();
  EXPECT_FALSE(with->predictions(0).SerializeAsString() ==
               without->predictions(0).SerializeAsString());
}

TEST_F(DefaultModelTest, AGenericActionGoesFartherAtAHigherSpeed) {
  const auto client = Connect();
  v1::GetActionSetRequest request;
  request.set_name("models/tiny/versions/1");
  double last = -std::numeric_limits<double>::infinity();
  for (const double speed : {0.0, 5.0, 10.0, 20.0}) {
    request.set_speed(speed);
    const auto set = client->GetActionSet(request);
    ASSERT_TRUE(set.ok()) << set.status();
    double sum = 0.0;  // of the ends of all actions
    for (const v1::Action& action : set->actions()) {
      sum += *action.distribution().mean_trajectory().x().rbegin();
    }
    EXPECT_GT(sum, last) << speed;
    last = sum;
  }
}

TEST_F(DefaultModelTest, RefusesATargetOfATypeThatItHasNotLearned) {
  const auto client = Connect();
  v1::PredictRequest request = Request();
  v1::Scenario& scenario = *request.mutable_scenarios(0);
  for (v1::Agent& agent : *scenario.mutable_agents()) {
    if (agent.id() == scenario.target_ids(0)) agent.set_type(v1::AGENT_TYPE_PEDESTRIAN);
  }
  const auto answer = client->Predict(request);
  ASSERT_TRUE(answer.ok()) << answer.status();
  const v1::TargetPrediction& target = answer->predictions(0).targets(0);
  EXPECT_THAT(target.error().message(), HasSubstr("has learned to predict vehicles alone"));
  EXPECT_FALSE(answer->predictions(1).targets(0).has_error());
}

}  // namespace
}  // namespace maneuver::integration::default_model_test
