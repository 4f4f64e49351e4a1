#include "server/serving/past_answers.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "server/monitoring/prometheus_metrics.h"

namespace maneuver::serving::past_answers_test {
namespace {

constexpr int64_t kPlenty = int64_t{1} << 20;
const security::ModelVersionName kFirst{"town", 1};
const security::ModelVersionName kSecond{"town", 2};

PastAnswer Answer(const std::string& scenario, const security::ModelVersionName& version = kFirst,
                  int features = 1) {
  PastAnswer answer;
  answer.scenario_id = scenario;
  answer.target_id = 7;
  answer.prediction_time = 2.5;
  answer.version = version;
  answer.encoding.features = Eigen::VectorXf::Zero(features);
  return answer;
}

TEST(PastAnswerMakerTest, RemembersSpeedAgentsAndMapOfTheInput) {
  std::vector<v1::Scenario> scenarios(2);
  for (int s = 0; s < 2; ++s) {
    v1::Scenario& scenario = scenarios[static_cast<size_t>(s)];
    scenario.set_scenario_id(std::to_string(s));
    scenario.set_prediction_time(2.0);
    // The last agent has left before the prediction time.
    for (int i = 0; i <= 3 + s; ++i) {
      v1::Agent& agent = *scenario.add_agents();
      agent.set_id(i);
      for (const double time : {0.9, 1.0, 2.0}) {
        if (i == 3 + s && time == 2.0) continue;
        v1::AgentState& state = *agent.add_states();
        state.set_time(time);
        state.set_velocity_x(8.0F);
      }
    }
    v1::MapFeature& feature = *scenario.add_map_features();
    feature.add_x(10.0);
    feature.add_y(10.0);
  }
  v1::ModelSpec spec;
  spec.mutable_raster()->mutable_frame_interval()->set_nanos(100'000'000);
  spec.mutable_raster()->set_history_frames(2);
  PastAnswerMaker maker(kFirst, spec);
  for (int s = 0; s < 2; ++s) {
    for (int64_t id = 0; id < 3; ++id) {
      Target target;
      target.scenario = &scenarios[static_cast<size_t>(s)];
      target.id = id;
      const PastAnswer answer = maker.Make(target, {});
      EXPECT_EQ(answer.version, kFirst);
      EXPECT_EQ(answer.target_id, id);
      EXPECT_NEAR(answer.speed, 8.0, 1e-6);
      EXPECT_EQ(answer.agents, 3 + s);
      EXPECT_EQ(answer.map_features, 1);
    }
  }
}

class PastAnswersTest : public ::testing::Test {
 protected:
  // The value of maneuver_outcome_NAME.
  double Shown(const std::string& name) const {
    const std::string page = metrics_->Page();
    const std::string line = "\nmaneuver_outcome_" + name + " ";
    return std::stod(page.substr(page.find(line) + line.size()));
  }

  const std::unique_ptr<monitoring::PrometheusMetrics> metrics_ =
      monitoring::PrometheusMetrics::Create();
};

TEST_F(PastAnswersTest, FindsAnAnswerByScenarioTargetTimeAndVersion) {
  PastAnswers answers(kPlenty, *metrics_);
  answers.Keep(Answer("a"));
  EXPECT_NE(answers.Find("a", 7, 2.5, {}), nullptr);
  EXPECT_NE(answers.Find("a", 7, 2.5, kFirst), nullptr);
  EXPECT_EQ(answers.Find("a", 7, 2.5, kSecond), nullptr);
  EXPECT_EQ(answers.Find("a", 8, 2.5, {}), nullptr);
  EXPECT_EQ(answers.Find("a", 7, 2.6, {}), nullptr);
  EXPECT_EQ(answers.Find("b", 7, 2.5, {}), nullptr);
}

TEST_F(PastAnswersTest, WithoutAVersionTheLatestAnswerCounts) {
  PastAnswers answers(kPlenty, *metrics_);
  answers.Keep(Answer("a", kSecond));
  answers.Keep(Answer("a", kFirst));
  EXPECT_EQ(answers.Find("a", 7, 2.5, {})->version, kFirst);
  answers.Keep(Answer("a", kSecond));
  EXPECT_EQ(answers.Find("a", 7, 2.5, {})->version, kSecond);
  EXPECT_EQ(Shown("kept_answers"), 2.0);
  EXPECT_EQ(Shown("dropped_answers_total"), 0.0);
}

TEST_F(PastAnswersTest, AnAnswerIsRemovedOnce) {
  PastAnswers answers(kPlenty, *metrics_);
  answers.Keep(Answer("a"));
  const auto found = answers.Find("a", 7, 2.5, {});
  answers.Keep(Answer("a"));  // another prediction of the same
  EXPECT_FALSE(answers.Remove(*found));
  const auto latest = answers.Find("a", 7, 2.5, {});
  EXPECT_TRUE(answers.Remove(*latest));
  EXPECT_FALSE(answers.Remove(*latest));
  EXPECT_EQ(answers.Find("a", 7, 2.5, {}), nullptr);
  EXPECT_EQ(Shown("kept_answer_bytes"), 0.0);
}

TEST_F(PastAnswersTest, DropsAndCountsTheOldestAboveItsLimit) {
  constexpr int kFeatures = 25'000;  // 100 kB each
  PastAnswers answers(kPlenty, *metrics_);
  for (int i = 0; i < 30; ++i) {
    answers.Keep(Answer(std::to_string(i), kFirst, kFeatures));
    EXPECT_LE(Shown("kept_answer_bytes"), kPlenty);
  }
  EXPECT_EQ(Shown("kept_answer_limit_bytes"), kPlenty);
  EXPECT_EQ(Shown("kept_answers"), 10.0);
  EXPECT_EQ(Shown("dropped_answers_total"), 20.0);
  EXPECT_EQ(answers.Find("19", 7, 2.5, {}), nullptr);
  EXPECT_NE(answers.Find("20", 7, 2.5, {}), nullptr);
  // One that does not fit at all.
  answers.Keep(Answer("large", kFirst, 1'000'000));
  EXPECT_EQ(answers.Find("large", 7, 2.5, {}), nullptr);
}

TEST_F(PastAnswersTest, DoesNotKeepWhatNobodyCanName) {
  PastAnswers answers(kPlenty, *metrics_);
  answers.Keep(Answer(""));
  EXPECT_EQ(Shown("kept_answer_bytes"), 0.0);
}

}  // namespace
}  // namespace maneuver::serving::past_answers_test
