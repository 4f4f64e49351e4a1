#include "client/load/request_mix.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

namespace maneuver::load::request_mix_test {
namespace {

// Agents 10 * id, 10 * id + 1, ...: each is a target with one state before and one after the
// prediction time.
v1::Scenario Scene(int id, int targets) {
  v1::Scenario scene;
  scene.set_scenario_id(std::to_string(id));
  scene.set_prediction_time(5.0);
  for (int i = 0; i < targets; ++i) {
    v1::Agent& agent = *scene.add_agents();
    agent.set_id(10 * id + i);
    agent.add_states()->set_time(5.0);
    agent.add_states()->set_time(6.0);
    scene.add_target_ids(agent.id());
  }
  return scene;
}

int Targets(const v1::PredictRequest& request) {
  int targets = 0;
  for (const v1::Scenario& scene : request.scenarios()) targets += scene.target_ids_size();
  return targets;
}

TEST(RequestMixTest, NumbersOfTargetsCoverTheirRange) {
  const std::vector<v1::PredictRequest> requests =
      MakeRequests({Scene(1, 2), Scene(2, 4)}, {},
                   {.least_targets = 2, .most_targets = 6, .requests = 200, .seed = 1});
  std::map<int, int> counts;
  for (const v1::PredictRequest& request : requests) ++counts[Targets(request)];
  ASSERT_EQ(counts.size(), 5U);
  for (const auto& [targets, count] : counts) {
    EXPECT_GE(targets, 2);
    EXPECT_LE(targets, 6);
    EXPECT_GT(count, 20);  // 40 expected
  }
}

TEST(RequestMixTest, EveryTargetIsDrawnAndNeverTwiceInAScene) {
  std::set<int64_t> seen;
  for (const v1::PredictRequest& request :
       MakeRequests({Scene(3, 4)}, {}, {.least_targets = 2, .most_targets = 2, .requests = 50})) {
    ASSERT_EQ(request.scenarios_size(), 1);
    const auto& targets = request.scenarios(0).target_ids();
    EXPECT_EQ(std::set<int64_t>(targets.begin(), targets.end()).size(), 2U);
    seen.insert(targets.begin(), targets.end());
  }
  EXPECT_THAT(seen, ::testing::ElementsAre(30, 31, 32, 33));
}

TEST(RequestMixTest, SendsNothingAfterThePredictionTime) {
  v1::PredictRequest pattern;
  pattern.set_model("models/town");
  pattern.mutable_query()->set_top_k(3);
  for (const v1::PredictRequest& request : MakeRequests({Scene(1, 2)}, pattern, {.requests = 3})) {
    EXPECT_EQ(request.model(), "models/town");
    EXPECT_EQ(request.query().top_k(), 3);
    EXPECT_EQ(request.scenarios(0).agents(0).states_size(), 1);
  }
}

TEST(RequestMixTest, TheSeedDecidesTheRequests) {
  const std::vector<v1::Scenario> scenes = {Scene(1, 3), Scene(2, 3)};
  const auto text = [&](uint64_t seed) {
    std::string all;
    for (const auto& request : MakeRequests(scenes, {}, {.most_targets = 3, .seed = seed})) {
      all += request.SerializeAsString();
    }
    return all;
  };
  EXPECT_EQ(text(1), text(1));
  EXPECT_NE(text(1), text(2));
}

}  // namespace
}  // namespace maneuver::load::request_mix_test
