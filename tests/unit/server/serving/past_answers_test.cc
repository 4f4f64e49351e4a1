#include "server/serving/past_answers.h"

#include <gtest/gtest.h>

#include <string>

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
