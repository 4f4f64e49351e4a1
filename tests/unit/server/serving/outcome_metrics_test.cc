#include "server/serving/outcome_metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <optional>
#include <string>

#include "server/monitoring/prometheus_metrics.h"
#include "tests/unit/server/serving/fake_action_model.h"

namespace maneuver::serving::outcome_metrics_test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

// The fake model with what a trained one says of its validation.
class TrainedModel final : public inference::ActionModel {
 public:
  //   highest_speed: of the held-out examples, m/s; without it, the model is of before there were
  //   ranges of inputs
  explicit TrainedModel(FakeNetworks& networks, std::optional<double> highest_speed = {})
      : fake_(networks), manifest_(fake_.manifest()) {
    if (highest_speed) {
      for (const char* input : {"speed", "agents", "map"}) {
        (*manifest_.mutable_input_ranges())[input].set_high(*highest_speed);
      }
    }
    for (int k = 0; k < kFakeActions; ++k) {
      v1::Action& action = *manifest_.add_actions();
      action.set_action_id(k);
      action.set_usage(0.25 * (k + 1));
    }
    (*manifest_.mutable_metrics())["coverage_2sigma"] = 0.8;
  }
  const v1::ModelManifest& manifest() const override { return manifest_; }
  std::string_view precision() const override { return "f32"; }
  size_t weight_bytes() const override { return 4; }
  std::unique_ptr<inference::InferenceSession> NewSession() const override {
    return fake_.NewSession();
  }

 private:
  const FakeActionModel fake_;
  v1::ModelManifest manifest_;
};

ScoredOutcome Outcome(double value, const Eigen::Vector3d& probabilities) {
  ScoredOutcome outcome;
  outcome.metrics.fill(value);
  outcome.measurement.probabilities = probabilities;
  outcome.measurement.responsibilities = probabilities;
  outcome.speed_stratum = "5-10 m/s";
  return outcome;
}

class OutcomeMetricsTest : public ::testing::Test {
 protected:
  ServedModel Model(int version) {
    return {{"town", version}, std::make_shared<TrainedModel>(networks_)};
  }
  std::string Page() const { return page_->Page(); }

  FakeNetworks networks_;
  const std::unique_ptr<monitoring::PrometheusMetrics> page_ =
      monitoring::PrometheusMetrics::Create();
  OutcomeMetrics metrics_{*page_};
};

TEST_F(OutcomeMetricsTest, ShowsScoresByVersionAndSpeed) {
  const ServedModel model = Model(3);
  metrics_.Observe(model, Outcome(0.5, {0.75, 0.25, 0.0}));
  metrics_.Observe(model, Outcome(0.25, {0.0, 0.0, 1.0}));
  const std::string page = Page();
  const std::string labels = R"({model_version="town/3",speed="5-10 m/s"})";
  EXPECT_THAT(page, HasSubstr("maneuver_outcome_targets_total{result=\"scored\"} 2"));
  EXPECT_THAT(page, HasSubstr("maneuver_outcome_scored_total" + labels + " 2"));
  EXPECT_THAT(page, HasSubstr("maneuver_outcome_nll_nats_sum" + labels + " 0.75"));
  EXPECT_THAT(
      page,
      HasSubstr(
          R"(maneuver_outcome_displacement_meters_bucket{measure="min_fde_6",model_version="town/3",speed="5-10 m/s",le="0.3"} 1)"));
  EXPECT_THAT(
      page,
      HasSubstr(
          R"(maneuver_outcome_covered_total{model_version="town/3",sigma="2",speed="5-10 m/s"} 0.75)"));
}

TEST_F(OutcomeMetricsTest, ShowsSharesOfActionsAndCoverageBesideThoseOfTheTraining) {
  const ServedModel model = Model(3);
  metrics_.Observe(model, Outcome(0.5, {0.75, 0.25, 0.0}));
  metrics_.Observe(model, Outcome(0.5, {0.5, 0.5, 0.0}));
  const std::string page = Page();
  for (const char* line :
       {R"(maneuver_outcome_action_probability_total{action="0",model_version="town/3"} 1.25)",
        R"(maneuver_outcome_action_probability_total{action="2",model_version="town/3"} 0)",
        R"(maneuver_outcome_expected_action_ratio{action="0",model_version="town/3"} 0.25)",
        R"(maneuver_outcome_expected_action_ratio{action="2",model_version="town/3"} 0.75)",
        R"(maneuver_outcome_expected_coverage_ratio{model_version="town/3",sigma="1"} 0.393)",
        R"(maneuver_outcome_expected_coverage_ratio{model_version="town/3",sigma="2"} 0.8)"}) {
    EXPECT_THAT(page, HasSubstr(line));
  }
}

TEST_F(OutcomeMetricsTest, ShowsHowOftenTheLikeliestActionWasTakenByItsProbability) {
  const ServedModel model = Model(3);
  ScoredOutcome outcome = Outcome(0.5, {0.75, 0.25, 0.0});
  outcome.measurement.responsibilities = Eigen::Vector3d(0.5, 0.25, 0.25);
  metrics_.Observe(model, outcome);
  outcome.measurement.responsibilities = Eigen::Vector3d(0.0, 1.0, 0.0);
  metrics_.Observe(model, outcome);
  metrics_.Observe(model, Outcome(0.25, {0.0, 0.0, 1.0}));
  const std::string page = Page();
  const std::string seven = R"({model_version="town/3",probability="0.7"} )";
  EXPECT_THAT(page, HasSubstr("maneuver_outcome_likeliest_total" + seven + "2\n"));
  EXPECT_THAT(page, HasSubstr("maneuver_outcome_likeliest_probability_total" + seven + "1.5\n"));
  EXPECT_THAT(page, HasSubstr("maneuver_outcome_likeliest_responsibility_total" + seven + "0.5\n"));
  EXPECT_THAT(
      page,
      HasSubstr(R"(maneuver_outcome_likeliest_total{model_version="town/3",probability="0.9"} 1)"));
}

TEST_F(OutcomeMetricsTest, LateVersionsShareOneLabel) {
  const int most = static_cast<int>(OutcomeMetrics::kMostVersions);
  for (int version = 1; version <= most + 5; ++version) {
    const ServedModel model = Model(version);
    metrics_.Observe(model, Outcome(0.5, {0.75, 0.25, 0.0}));
  }
  const std::string page = Page();
  EXPECT_THAT(page, HasSubstr("model_version=\"town/" + std::to_string(most) + "\""));
  EXPECT_THAT(page, Not(HasSubstr("model_version=\"town/" + std::to_string(most + 1) + "\"")));
  EXPECT_THAT(page, HasSubstr(R"(scored_total{model_version="_others",speed="5-10 m/s"} 5)"));
  EXPECT_THAT(page, Not(HasSubstr(R"(action="0",model_version="_others")")));
}

TEST_F(OutcomeMetricsTest, CountsInputsOutsideOfWhatTheModelWasTrainedOn) {
  const ServedModel model({"town", 3}, std::make_shared<TrainedModel>(networks_, 15.0));
  ScoredOutcome outcome = Outcome(0.5, {0.75, 0.25, 0.0});
  outcome.measurement.keys = {.agents = 15, .speed = 15.0, .map_features = 3};
  metrics_.Observe(model, outcome);
  outcome.measurement.keys = {.agents = 16, .speed = 15.5, .map_features = 3};
  metrics_.Observe(model, outcome);
  outcome.measurement.keys = {.agents = 2, .speed = 90.0, .map_features = 0};
  metrics_.Observe(model, outcome);
  const std::string page = Page();
  const std::string name = "maneuver_outcome_outside_training_total";
  EXPECT_THAT(page, HasSubstr(name + R"({input="speed",model_version="town/3"} 2)"));
  EXPECT_THAT(page, HasSubstr(name + R"({input="agents",model_version="town/3"} 1)"));
  EXPECT_THAT(page, HasSubstr(name + R"({input="map",model_version="town/3"} 0)"));
}

TEST_F(OutcomeMetricsTest, AModelWithoutRangesHasNoShareOfInputsOutside) {
  const ServedModel model = Model(3);
  ScoredOutcome outcome = Outcome(0.5, {0.75, 0.25, 0.0});
  outcome.measurement.keys.speed = 90.0;
  metrics_.Observe(model, outcome);
  EXPECT_THAT(Page(), Not(HasSubstr("outside_training")));
}

TEST_F(OutcomeMetricsTest, CountsWhatCannotBeScored) {
  metrics_.CountFailed(absl::NotFoundError("not kept"));
  metrics_.CountFailed(absl::InvalidArgumentError("NaN"));
  metrics_.CountFailed(absl::InvalidArgumentError("NaN"));
  metrics_.CountFailed(absl::InternalError("not finite"));
  const std::string page = Page();
  EXPECT_THAT(page, HasSubstr("maneuver_outcome_targets_total{result=\"unknown\"} 1"));
  EXPECT_THAT(page, HasSubstr("maneuver_outcome_targets_total{result=\"invalid\"} 2"));
  EXPECT_THAT(page, HasSubstr("maneuver_outcome_targets_total{result=\"failed\"} 1"));
}

}  // namespace
}  // namespace maneuver::serving::outcome_metrics_test
