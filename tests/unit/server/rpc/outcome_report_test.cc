#include "server/rpc/outcome_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <future>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "model/data/example_index.h"
#include "model/data/town/synthetic_town.h"
#include "model/evaluation/evaluator.h"
#include "model/files/errno_status.h"
#include "model/scene/target_frame.h"
#include "server/errors/error_details.h"
#include "server/monitoring/prometheus_metrics.h"
#include "server/rpc/predict_stream.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/model/inference/reference_model.h"
#include "tests/unit/server/rpc/prediction_messages.h"
#include "tests/unit/server/serving/fake_action_model.h"
#include "tests/unit/server/serving/memory_alias_store.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::rpc::outcome_report_test {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

// Eight actions over 2.5 s.
v1::ModelSpec TownSpec() {
  v1::ModelSpec spec = artifact::TinySpec();
  spec.set_actions(8);
  spec.mutable_trajectory()->set_waypoints(5);
  spec.mutable_trajectory()->mutable_waypoint_interval()->set_nanos(500'000'000);
  return spec;
}

v1::ExampleSettings EveryThreeSeconds() {
  return FromText<v1::ExampleSettings>(
      "stride { seconds: 3 } keep_standing: 1 standing_distance: 1 max_speed: 45");
}

// The outcome of one example: the recording up to its time, and what the target did then.
v1::Outcome OutcomeOf(const v1::Scenario& recording, const data::Example& example) {
  v1::Outcome outcome;
  v1::Scenario& scene = *outcome.mutable_scenario();
  scene = recording;
  scene.set_prediction_time(example.time);
  v1::TargetOutcome& target = *outcome.add_targets();
  target.set_target_id(example.target_id);
  for (v1::Agent& agent : *scene.mutable_agents()) {
    const google::protobuf::RepeatedPtrField<v1::AgentState> states = agent.states();
    agent.clear_states();
    for (const v1::AgentState& state : states) {
      if (state.time() <= example.time + scene::kSameTime) {
        *agent.add_states() = state;
      } else if (agent.id() == example.target_id) {
        *target.add_states() = state;
      }
    }
  }
  return outcome;
}

// A model "town" whose networks are random, and recordings of the town.
class OutcomeReportTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto loaded = inference::ActionModel::FromStored(inference::RandomModel(TownSpec(), 5),
                                                     {.precision = inference::Precision::kF32});
    ASSERT_TRUE(loaded.ok()) << loaded.status();
    model_ = *std::move(loaded);
    Serve([this] { return model_; });
    for (int i = 0; i < 2; ++i) {
      recordings_.push_back(data::town::GenerateRecording({.seed = 4}, i).scenario);
      for (const data::Example& example :
           data::EnumerateExamples(recordings_.back(), i, TownSpec(), EveryThreeSeconds())) {
        outcomes_.push_back(OutcomeOf(recordings_.back(), example));
      }
    }
    ASSERT_GT(outcomes_.size(), 20u);
  }

  void Serve(std::function<std::shared_ptr<const inference::ActionModel>()> load) {
    scheduler_ = nullptr;
    context_ = nullptr;
    fs::remove_all(folder_ / "models");
    auto versions = serving::VersionStore::Open(folder_ / "models");
    ASSERT_TRUE(versions.ok()) << versions.status();
    versions_ = *std::move(versions);
    auto models = serving::ServingTable::Open(
        *versions_, aliases_,
        [this,
         load](const fs::path&) -> absl::StatusOr<std::shared_ptr<const inference::ActionModel>> {
          if (!folder_is_there_) return files::ErrnoStatus(EIO, "read", "weights.safetensors");
          return load();
        },
        {.max_unaliased_in_memory = 0, .retry_load = {}}, monitoring::MetricRegistry::Null());
    ASSERT_TRUE(models.ok()) << models.status();
    models_ = *std::move(models);
    for (int version = 0; version < 2; ++version) {
      fs::create_directories(folder_ / "finished");
      std::ofstream(folder_ / "finished" / "weights.safetensors") << version;
      ASSERT_TRUE(models_->Publish("town", folder_ / "finished", v1::PROMOTION_UNSPECIFIED).ok());
    }
    scheduler_ = std::make_unique<serving::BatchScheduler>(
        serving::SchedulerOptions{.workers = 1, .queue = {.max_queue = 300}}, *page_);
    context_ =
        std::make_unique<PredictionContext>(PredictionContext{.models = *models_,
                                                              .scheduler = *scheduler_,
                                                              .maps = maps_,
                                                              .send_memory = send_memory_,
                                                              .blocking = blocking_,
                                                              .loading = blocking_,
                                                              .limits = {},
                                                              .access = *access_,
                                                              .past_answers = &past_answers_});
  }

  absl::Status Report(const v1::ReportOutcomesRequest& request,
                      serving::TimePoint deadline = serving::TimePoint::max(),
                      bool cancelled = false) {
    response_.Clear();
    return ReportOutcomes(
        *context_, metrics_, request, deadline, [cancelled] { return cancelled; }, &response_,
        collection_.get());
  }

  // Reports one outcome and returns its score.
  v1::OutcomeScore ReportOne(const v1::Outcome& outcome) {
    v1::ReportOutcomesRequest request;
    *request.add_outcomes() = outcome;
    const absl::Status status = Report(request);
    EXPECT_TRUE(status.ok()) << status;
    return status.ok() ? response_.scores(0) : v1::OutcomeScore();
  }

  // Asks PredictionService's way for the scene of an outcome. Returns the outcome by its id.
  v1::Outcome Predict(const v1::Outcome& outcome, const std::string& model = "models/town") {
    v1::PredictRequest request;
    v1::PredictResponse response;
    request.set_model(model);
    *request.add_scenarios() = outcome.scenario();
    request.mutable_scenarios(0)->clear_target_ids();
    request.mutable_scenarios(0)->add_target_ids(outcome.targets(0).target_id());
    std::promise<absl::Status> done;
    const auto run = PredictionRun::Start(
        *context_, PredictIo(request, &response), serving::TimePoint::max(), nullptr,
        [&done](absl::Status status) { done.set_value(std::move(status)); });
    const absl::Status status = done.get_future().get();
    EXPECT_TRUE(status.ok()) << status;
    v1::Outcome by_id = outcome;
    by_id.set_scenario_id(outcome.scenario().scenario_id());
    by_id.set_prediction_time(outcome.scenario().prediction_time());
    return by_id;
  }

  // The value of maneuver_outcome_targets_total.
  double Counted(const std::string& result) const {
    const std::string page = page_->Page();
    const std::string line = "maneuver_outcome_targets_total{result=\"" + result + "\"} ";
    return std::stod(page.substr(page.find(line) + line.size()));
  }

  const TemporaryFolder folder_;
  bool folder_is_there_ = true;
  const std::unique_ptr<monitoring::PrometheusMetrics> page_ =
      monitoring::PrometheusMetrics::Create();
  const std::unique_ptr<security::AccessControl> access_ =
      *security::AccessControl::Create({}, *page_);
  serving::MemoryAliasStore aliases_;
  std::shared_ptr<const inference::ActionModel> model_;
  serving::FakeNetworks networks_;
  std::unique_ptr<serving::VersionStore> versions_;
  std::unique_ptr<serving::ServingTable> models_;
  serving::SendMemory send_memory_{{.max_response_bytes = 1 << 20, .max_send_memory = 8 << 20},
                                   *page_};
  serving::MapCache maps_{{.max_maps = 2}, *page_};
  WorkerPool blocking_{1, 10};
  serving::PastAnswers past_answers_{1 << 20, *page_};
  serving::OutcomeMetrics metrics_{*page_};
  std::unique_ptr<serving::BatchScheduler> scheduler_;
  std::unique_ptr<PredictionContext> context_;
  std::vector<v1::Scenario> recordings_;
  std::vector<v1::Outcome> outcomes_;
  v1::ReportOutcomesResponse response_;
  std::unique_ptr<serving::OutcomeCollection> collection_;  // nullptr: none are collected
};

TEST_F(OutcomeReportTest, MetricsEqualThoseOfAnEvaluationOfTheSameRecordings) {
  evaluation::EvaluationInput input;
  input.recordings = recordings_;
  input.examples = EveryThreeSeconds();
  const auto report = evaluation::Evaluate(*model_, input);
  ASSERT_TRUE(report.ok()) << report.status();
  ASSERT_EQ(report->examples(), static_cast<int64_t>(outcomes_.size()));

  // Sums over outcomes; under "" those of all, and else those of a speed stratum.
  std::map<std::string, std::map<std::string, double>> sums;
  std::map<std::string, int64_t> counts;
  std::vector<int64_t> actions(8);
  for (const v1::Outcome& outcome : outcomes_) {
    const v1::OutcomeScore score = ReportOne(outcome);
    ASSERT_FALSE(score.has_error()) << score.error().message();
    const v1::TargetScore& target = score.targets(0);
    ASSERT_FALSE(target.has_error()) << target.error().message();
    ASSERT_EQ(target.metrics_size(), 7);
    for (const std::string& part : {std::string(), target.speed_stratum()}) {
      for (const auto& [name, value] : target.metrics()) sums[part][name] += value;
      ++counts[part];
    }
    ++actions[static_cast<size_t>(target.action_id())];
  }
  const auto expect = [&](const std::string& part, const auto& expected) {
    for (const auto& [name, sum] : sums[part]) {
      const double mean = sum / static_cast<double>(counts[part]);
      // Evaluations hold trajectories as floats.
      EXPECT_NEAR(mean, expected.at(name), 1e-5 * (1.0 + std::abs(mean))) << part << " " << name;
    }
  };
  expect("", report->metrics());
  std::set<std::string> strata;
  for (const v1::EvaluationStratum& stratum : report->strata()) {
    if (stratum.dimension() != "speed" || stratum.examples() == 0) continue;
    EXPECT_EQ(counts[stratum.name()], stratum.examples()) << stratum.name();
    // Strata hold the main metrics alone.
    sums[stratum.name()].erase("fde_1");
    expect(stratum.name(), stratum.metrics());
    strata.insert(stratum.name());
  }
  EXPECT_GT(strata.size(), 1u);
  for (size_t k = 0; k < actions.size(); ++k) {
    EXPECT_EQ(actions[k], report->action_uses(static_cast<int>(k)).examples()) << k;
  }
  EXPECT_EQ(Counted("scored"), static_cast<double>(outcomes_.size()));
}

TEST_F(OutcomeReportTest, CollectsScoredOutcomesWithTheirScenesOnceEach) {
  const fs::path folder = folder_ / "outcomes";
  collection_ = *serving::OutcomeCollection::Open(folder, 64 << 20, *page_);
  const v1::Outcome by_id = Predict(outcomes_[5]);
  v1::ReportOutcomesRequest request;
  for (int i = 0; i < 4; ++i) *request.add_outcomes() = outcomes_[static_cast<size_t>(i)];
  request.mutable_outcomes(1)->mutable_targets(0)->mutable_states()->Clear();
  request.mutable_outcomes(2)->mutable_scenario()->mutable_agents(0)->set_length(-1.0);
  *request.add_outcomes() = by_id;
  for (int time = 0; time < 2; ++time) {
    ASSERT_TRUE(Report(request).ok());
    EXPECT_EQ(std::distance(fs::directory_iterator(folder), {}), 2);
  }
  // The name ends with the surprise.
  for (const int i : {0, 3}) {
    ASSERT_FALSE(response_.scores(i).targets(0).has_error());
    const double nll = response_.scores(i).targets(0).metrics().at("nll");
    char surprise[40];
    std::snprintf(surprise, sizeof surprise, ",%.3f.outcome", std::round(1000.0 * nll) / 1000.0);
    const auto named = std::ranges::count_if(
        fs::directory_iterator(folder), [&surprise](const fs::directory_entry& entry) {
          return entry.path().filename().string().ends_with(surprise);
        });
    EXPECT_EQ(named, 1) << surprise;
  }
}

TEST_F(OutcomeReportTest, CountsNothingIfTheOutcomesCannotBeCollected) {
  collection_ = *serving::OutcomeCollection::Open(folder_ / "outcomes", 64 << 20, *page_);
  fs::remove_all(folder_ / "outcomes");
  v1::ReportOutcomesRequest request;
  *request.add_outcomes() = outcomes_[0];
  EXPECT_FALSE(Report(request).ok());
  EXPECT_EQ(Counted("scored"), 0.0);
}

TEST_F(OutcomeReportTest, AKeptAnswerGivesTheScoreOfItsSceneOnce) {
  const v1::OutcomeScore by_scene = ReportOne(outcomes_[3]);
  const v1::Outcome by_id = Predict(outcomes_[3]);
  const v1::OutcomeScore score = ReportOne(by_id);
  ASSERT_FALSE(score.targets(0).has_error()) << score.targets(0).error().message();
  EXPECT_EQ(score.targets(0).DebugString(), by_scene.targets(0).DebugString());
  EXPECT_EQ(Counted("scored"), 2.0);

  const v1::OutcomeScore again = ReportOne(by_id);
  EXPECT_EQ(errors::ReasonOf(errors::FromProto(again.targets(0).error())), "ANSWER_NOT_KEPT");
  EXPECT_EQ(Counted("scored"), 2.0);
  EXPECT_EQ(Counted("unknown"), 1.0);
}

TEST_F(OutcomeReportTest, OneReportScoresAKeptAnswerOnceThoughItNamesItTwice) {
  v1::ReportOutcomesRequest request;
  *request.add_outcomes() = Predict(outcomes_[3]);
  *request.add_outcomes() = request.outcomes(0);
  ASSERT_TRUE(Report(request).ok());
  EXPECT_FALSE(response_.scores(0).targets(0).has_error());
  EXPECT_EQ(response_.scores(1).targets(0).error().code(), 5);  // NOT_FOUND
  EXPECT_EQ(Counted("scored"), 1.0);
}

TEST_F(OutcomeReportTest, AnOutcomeNamesTheVersionThatPredicted) {
  v1::Outcome outcome = Predict(outcomes_[3], "models/town/versions/1");
  Predict(outcomes_[3], "models/town/versions/2");
  outcome.set_model("models/town/versions/1");
  EXPECT_EQ(ReportOne(outcome).targets(0).model_version(), "models/town/versions/1");
  outcome.clear_model();
  EXPECT_EQ(ReportOne(outcome).targets(0).model_version(), "models/town/versions/2");

  v1::Outcome scene = outcomes_[3];
  scene.set_model("models/town/versions/2");
  EXPECT_EQ(ReportOne(scene).targets(0).model_version(), "models/town/versions/2");
  scene.set_model("models/town/versions/9");
  EXPECT_EQ(ReportOne(scene).error().code(), 5);  // NOT_FOUND
}

TEST_F(OutcomeReportTest, StatesOfTheSceneAfterThePredictionTimeDoNotMatter) {
  v1::Outcome outcome = outcomes_[3];
  const v1::OutcomeScore expected = ReportOne(outcome);
  for (v1::Agent& agent : *outcome.mutable_scenario()->mutable_agents()) {
    v1::AgentState& later = *agent.add_states();
    later.set_time(outcome.scenario().prediction_time() + 0.3);
    later.set_x(1e6);
  }
  EXPECT_EQ(ReportOne(outcome).targets(0).DebugString(), expected.targets(0).DebugString());
}

TEST_F(OutcomeReportTest, EachInvalidItemFailsAloneWithItsPath) {
  const v1::Outcome good = outcomes_[3];
  const double now = good.scenario().prediction_time();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  struct Case {
    std::function<void(v1::Outcome&)> spoil;
    std::string field;
    bool whole;  // whether the whole outcome is refused
  };
  const auto state = [](v1::Outcome& outcome, int i) {
    return outcome.mutable_targets(0)->mutable_states(i);
  };
  const std::vector<Case> cases = {
      {[](auto& o) { o.clear_prediction(); }, "outcomes[1].scenario", true},
      {[](auto& o) { o.clear_targets(); }, "outcomes[1].targets", true},
      {[](auto& o) { *o.add_targets() = o.targets(0); }, "outcomes[1].targets[1].target_id", true},
      {[](auto& o) { o.set_scenario_id(""); }, "outcomes[1].scenario_id", true},
      {[](auto& o) { o.set_scenario_id(std::string(513, 'x')); }, "outcomes[1].scenario_id", true},
      {[&](auto& o) {
         o.set_scenario_id("x");
         o.set_prediction_time(nan);
       },
       "outcomes[1].prediction_time", true},
      {[](auto& o) { o.set_model("town"); }, "outcomes[1].model", true},
      {[&](auto& o) { o.mutable_scenario()->set_prediction_time(nan); },
       "outcomes[1].scenario.prediction_time", true},
      {[&](auto& o) { o.mutable_scenario()->mutable_agents(0)->mutable_states(0)->set_x(nan); },
       "outcomes[1].scenario.agents[0].states[0].x", true},
      {[](auto& o) { o.mutable_scenario()->set_map_id(std::string(64, 'a')); },
       "outcomes[1].scenario.map_id", true},
      {[](auto& o) { o.mutable_targets(0)->set_target_id(99); },
       "outcomes[1].scenario.target_ids[0]", false},
      {[](auto& o) { o.mutable_targets(0)->clear_states(); }, "outcomes[1].targets[0].states",
       false},
      {[&](auto& o) { state(o, 4)->set_x(nan); }, "outcomes[1].targets[0].states[4].x", false},
      {[&](auto& o) { state(o, 4)->set_heading(std::numeric_limits<float>::infinity()); },
       "outcomes[1].targets[0].states[4].heading", false},
      {[&](auto& o) { state(o, 4)->set_time(state(o, 3)->time()); },
       "outcomes[1].targets[0].states[4].time", false},
      {[&](auto& o) { state(o, 0)->set_time(now); }, "outcomes[1].targets[0].states[0].time",
       false},
      {[&](auto& o) { state(o, 4)->set_y(state(o, 4)->y() + 1e4); },
       "outcomes[1].targets[0].states[4]", false},
      {[](auto& o) {
         auto* states = o.mutable_targets(0)->mutable_states();
         states->DeleteSubrange(5, states->size() - 5);
       },
       "outcomes[1].targets[0].states", false},
      {[](auto& o) {
         v1::TargetOutcome& target = *o.mutable_targets(0);
         for (int i = 0; i < 2'000; ++i) {
           *target.add_states() = target.states(target.states_size() - 1);
         }
       },
       "outcomes[1].targets[0].states", false},
  };
  for (const Case& each : cases) {
    SCOPED_TRACE(each.field);
    v1::ReportOutcomesRequest request;
    *request.add_outcomes() = good;
    *request.add_outcomes() = good;
    each.spoil(*request.mutable_outcomes(1));
    const absl::Status status = Report(request);
    ASSERT_TRUE(status.ok()) << status;
    EXPECT_FALSE(response_.scores(0).targets(0).has_error());
    const v1::OutcomeScore& score = response_.scores(1);
    ASSERT_EQ(score.has_error(), each.whole) << score.DebugString();
    const v1::Status& error = each.whole ? score.error() : score.targets(0).error();
    EXPECT_EQ(error.code(), 3) << error.message();  // INVALID_ARGUMENT
    EXPECT_EQ(FirstField(errors::FromProto(error)), each.field);
  }
}

TEST_F(OutcomeReportTest, AMalformedModelIsThatOfEachOutcomeThatNamesIt) {
  v1::ReportOutcomesRequest request;
  request.set_model("town");
  for (const char* model : {"", "town", "town"}) {
    *request.add_outcomes() = outcomes_[3];
    request.mutable_outcomes()->rbegin()->set_model(model);
  }
  const absl::Status status = Report(request);
  ASSERT_TRUE(status.ok()) << status;
  std::vector<std::string> fields;
  for (const auto& score : response_.scores()) {
    fields.push_back(FirstField(errors::FromProto(score.error())));
  }
  EXPECT_THAT(fields, ElementsAre("model", "outcomes[1].model", "outcomes[2].model"));
}

TEST_F(OutcomeReportTest, WithoutAnyKeptAnswersAReportByIdSaysSo) {
  context_->past_answers = nullptr;
  const v1::OutcomeScore score = ReportOne(Predict(outcomes_[3]));
  EXPECT_EQ(score.targets(0).error().code(), 5);  // NOT_FOUND
  EXPECT_THAT(score.targets(0).error().message(), HasSubstr("keeps no answers"));
}

TEST_F(OutcomeReportTest, ALateOrAbandonedReportCountsNothingAndKeepsItsAnswers) {
  v1::ReportOutcomesRequest request;
  *request.add_outcomes() = Predict(outcomes_[3]);
  const auto past = std::chrono::steady_clock::now() - std::chrono::seconds(1);
  EXPECT_TRUE(absl::IsDeadlineExceeded(Report(request, past)));
  EXPECT_TRUE(absl::IsCancelled(Report(request, serving::TimePoint::max(), /*cancelled=*/true)));
  EXPECT_EQ(response_.scores_size(), 0);
  EXPECT_EQ(Counted("scored"), 0.0);
  EXPECT_TRUE(Report(request).ok());
  EXPECT_EQ(Counted("scored"), 1.0);
}

TEST_F(OutcomeReportTest, AnAbandonedReportOfASceneDoesNotRunTheNetworks) {
  Serve([this] { return std::make_shared<serving::FakeActionModel>(networks_); });
  v1::ReportOutcomesRequest request;
  *request.add_outcomes() = outcomes_[3];
  const int described = networks_.described();
  EXPECT_TRUE(absl::IsCancelled(Report(request, serving::TimePoint::max(), /*cancelled=*/true)));
  EXPECT_EQ(networks_.described(), described);
}

// The caller sends the report again; a server that remembered this answer would never score it.
TEST_F(OutcomeReportTest, AReportFailsAsAWholeWhileItsModelCannotBeLoaded) {
  v1::ReportOutcomesRequest request;
  *request.add_outcomes() = outcomes_[3];
  request.mutable_outcomes(0)->set_model("models/town/versions/2");
  *request.add_outcomes() = outcomes_[4];
  request.mutable_outcomes(1)->set_model("models/town/versions/1");
  folder_is_there_ = false;
  EXPECT_TRUE(absl::IsUnavailable(Report(request)));
  EXPECT_EQ(Counted("failed"), 0.0);
  folder_is_there_ = true;
  ASSERT_TRUE(Report(request).ok());
  EXPECT_EQ(Counted("scored"), 2.0);
}

// The fake model's covariances are 0, so its likelihoods are not finite.
TEST_F(OutcomeReportTest, AScoreThatIsNotFiniteIsWithheld) {
  Serve([this] { return std::make_shared<serving::FakeActionModel>(networks_); });
  const v1::OutcomeScore score = ReportOne(outcomes_[3]);
  ASSERT_EQ(score.targets_size(), 1) << score.error().message();
  const v1::Status& error = score.targets(0).error();
  EXPECT_EQ(error.code(), 13) << error.message();  // INTERNAL
  EXPECT_EQ(errors::ReasonOf(errors::FromProto(error)), "ANSWER_UNSOUND");
  EXPECT_EQ(Counted("failed"), 1.0);
}

}  // namespace
}  // namespace maneuver::rpc::outcome_report_test
