// Tests a real server that is told what really happened: its scores are those of an evaluation, and
// its metrics count each outcome once.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "google/protobuf/util/json_util.h"
#include "maneuver/v1/evaluation.pb.h"
#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/outcome_service.grpc.pb.h"
#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "tests/integration/metrics_page.h"
#include "tests/integration/trained_server.h"

namespace maneuver::integration::outcomes_test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::HasSubstr;

class OutcomesTest : public ::testing::Test {
 protected:
  // All tests share one server and its model.
  static void SetUpTestSuite() {
    trained_ = std::make_unique<TrainedServer>(
        std::vector<std::string>{"--outcome-memory", "16MiB", "--outcome-recordings", "64MiB"});
  }
  static void TearDownTestSuite() { trained_ = nullptr; }

  ServerProcess& server() { return trained_->server(); }

  std::string Run(std::vector<std::string> arguments, int status = 0) {
    std::string output;
    EXPECT_EQ(RunManeuver(server(), std::move(arguments), &output), status) << output;
    return output;
  }
  json Report(const std::string& source, bool kept = false) {
    std::vector<std::string> arguments = {"outcomes", "report",  source,     "--model",
                                          "tiny",     "--quiet", "--output", "json"};
    if (kept) arguments.emplace_back("--kept");
    return json::parse(Run(arguments));
  }
  v1::EvaluationReport Evaluation() {
    v1::GetEvaluationReportRequest request;
    request.set_name("models/tiny/versions/1/evaluations/unseen");
    v1::EvaluationReport report;
    grpc::ClientContext context;
    const auto status = v1::ModelService::NewStub(server().channel())
                            ->GetEvaluationReport(&context, request, &report);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return report;
  }
  double Counted(const std::string& result) {
    return ValueOf(MetricsPage(server()),
                   "maneuver_outcome_targets_total{result=\"" + result + "\"}");
  }

  // Returns the sum of the counts of all actions.
  double Actions() {
    const std::string page = MetricsPage(server());
    double sum = 0.0;
    for (int k = 0; k < 12; ++k) {
      const std::string labels = "{action=\"" + std::to_string(k) + "\",model_version=\"tiny/1\"}";
      sum += std::max(0.0, ValueOf(page, "maneuver_outcome_action_probability_total" + labels));
    }
    return sum;
  }

  static std::unique_ptr<TrainedServer> trained_;
};

std::unique_ptr<TrainedServer> OutcomesTest::trained_;

TEST_F(OutcomesTest, ReportedRecordingsScoreAsInAnEvaluation) {
  Run({"evaluate", "tiny", "--dataset", "unseen"});
  const v1::EvaluationReport expected = Evaluation();
  const double scored = Counted("scored");
  double actions = -Actions();
  ASSERT_GT(expected.examples(), 100);
  // A folder, and the same dataset on the server.
  for (const std::string& source :
       {(trained_->folder() / "unseen").string(), std::string("datasets/unseen")}) {
    SCOPED_TRACE(source);
    const json reported = Report(source);
    EXPECT_EQ(reported["outcomes"], expected.examples());
    EXPECT_EQ(reported["failed"], 0);
    ASSERT_EQ(reported["metrics"].size(), 7u);
    // In bf16 the last digits of an answer depend on its batch.
    for (const auto& [name, value] : reported["metrics"].items()) {
      const double evaluated = expected.metrics().at(name);
      EXPECT_NEAR(value, evaluated, 0.01 * std::abs(evaluated) + 0.002) << name;
    }
    size_t strata = 0;
    for (const v1::EvaluationStratum& stratum : expected.strata()) {
      if (stratum.dimension() != "speed" || stratum.examples() == 0) continue;
      ASSERT_LT(strata, reported["strata"].size());
      const json& part = reported["strata"][strata++];
      EXPECT_EQ(part["name"], stratum.name());
      EXPECT_EQ(part["outcomes"], stratum.examples());
      const double evaluated = stratum.metrics().at("min_fde_6");
      EXPECT_NEAR(part["metrics"]["min_fde_6"], evaluated, 0.01 * evaluated + 0.002);
    }
    EXPECT_EQ(reported["strata"].size(), strata);
  }

  EXPECT_EQ(Counted("scored") - scored, 2.0 * static_cast<double>(expected.examples()));
  actions += Actions();
  EXPECT_NEAR(actions, 2.0 * static_cast<double>(expected.examples()), 1e-3 * actions);
  const std::string page = MetricsPage(server());
  ExpectShape(ShapeOf(page, "maneuver_outcome_"), GOLDEN_OUTCOME_METRICS, ACTUAL_OUTCOME_METRICS);
  if (HasPromtool()) ExpectPromtoolIsContent(page, trained_->folder() / "page");
}

TEST_F(OutcomesTest, KeptAnswersAreScoredOnce) {
  const v1::Scenario& scene = trained_->unseen()[0];
  std::string text;
  ASSERT_TRUE(google::protobuf::util::MessageToJsonString(scene, &text).ok());
  const std::string file = (trained_->folder() / "scene.json").string();
  std::ofstream(file) << text;
  const double scored = Counted("scored");
  const double unknown = Counted("unknown");
  Run({"predict", file, "--model", "tiny"});
  const auto targets = static_cast<double>(scene.target_ids_size());
  EXPECT_EQ(ValueOf(MetricsPage(server()), "maneuver_outcome_kept_answers"), targets);
  EXPECT_EQ(Report(file, /*kept=*/true)["outcomes"], targets);
  EXPECT_EQ(Counted("scored") - scored, targets);
  const std::string again =
      Run({"outcomes", "report", file, "--model", "tiny", "--kept"}, /*status=*/1);
  EXPECT_THAT(again, HasSubstr("not scored yet"));
  EXPECT_EQ(Counted("scored") - scored, targets);
  EXPECT_EQ(Counted("unknown") - unknown, targets);
  EXPECT_EQ(ValueOf(MetricsPage(server()), "maneuver_outcome_kept_answers"), 0.0);
}

constexpr double kHorizon = 4.0;  // of the model, seconds

// Each target of the recordings, at their prediction times, that is there to the horizon.
std::vector<v1::ReportOutcomesRequest> ReportsOf(const std::vector<v1::Scenario>& recordings) {
  std::vector<v1::ReportOutcomesRequest> reports;
  for (const v1::Scenario& recording : recordings) {
    for (const int64_t id : recording.target_ids()) {
      v1::ReportOutcomesRequest report;
      report.set_model("models/tiny");
      v1::Outcome& outcome = *report.add_outcomes();
      *outcome.mutable_scenario() = recording;
      v1::TargetOutcome& target = *outcome.add_targets();
      target.set_target_id(id);
      for (const v1::Agent& agent : recording.agents()) {
        if (agent.id() != id) continue;
        for (const v1::AgentState& state : agent.states()) {
          if (state.time() > recording.prediction_time() + 1e-6) *target.add_states() = state;
        }
      }
      const double end = target.states().empty() ? 0.0 : target.states().rbegin()->time();
      if (end > recording.prediction_time() + kHorizon - 1e-6) reports.push_back(std::move(report));
    }
  }
  return reports;
}

// Returns the speed of the agent's last state until `time`, m/s.
double SpeedAt(const v1::Agent& agent, double time) {
  double speed = 0.0;
  for (const v1::AgentState& state : agent.states()) {
    if (state.time() <= time + 1e-6) speed = std::hypot(state.velocity_x(), state.velocity_y());
  }
  return speed;
}

// Stretches what was driven, about the origin of the world.
void Accelerate(double factor, google::protobuf::RepeatedPtrField<v1::AgentState>& states) {
  for (v1::AgentState& state : states) {
    state.set_x(factor * state.x());
    state.set_y(factor * state.y());
    state.set_velocity_x(static_cast<float>(factor * state.velocity_x()));
    state.set_velocity_y(static_cast<float>(factor * state.velocity_y()));
  }
}

// Returns why the outcome was not scored or its report not acknowledged; empty if both happened.
std::string Refusal(v1::OutcomeService::Stub& stub, const v1::ReportOutcomesRequest& report) {
  grpc::ClientContext context;
  v1::ReportOutcomesResponse response;
  const grpc::Status status = stub.ReportOutcomes(&context, report, &response);
  if (!status.ok()) return "refused: " + status.error_message();
  const v1::OutcomeScore& scores = response.scores(0);
  return scores.has_error() ? scores.error().message() : scores.targets(0).error().message();
}

// Returns the outcomes in the folder of the collection.
std::set<std::string> CollectedIn(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (name.front() != '.') names.insert(name);
  }
  return names;
}

TEST_F(OutcomesTest, AServerThatIsKilledHasEachAcknowledgedOutcomeOnce) {
  const auto collected = [this] { return CollectedIn(trained_->data_dir() / "outcomes"); };
  // What other tests left.
  Run({"outcomes", "collect", "before", "--forget"}, collected().empty() ? 1 : 0);
  ASSERT_TRUE(collected().empty());
  const std::vector<v1::ReportOutcomesRequest> reports = ReportsOf(trained_->unseen());
  ASSERT_GT(reports.size(), 20u);
  std::atomic<size_t> acknowledged = 0;
  std::atomic<bool> broken = false;
  {
    const auto stub = v1::OutcomeService::NewStub(server().channel());
    std::jthread fleet([&] {
      for (const v1::ReportOutcomesRequest& report : reports) {
        if (!Refusal(*stub, report).empty()) break;
        ++acknowledged;
      }
      broken = true;
    });
    while (acknowledged < 5 && !broken) std::this_thread::yield();
    server().Kill();
  }
  ASSERT_GE(acknowledged, 5u);
  EXPECT_GE(collected().size(), acknowledged);
  trained_->Restart();
  EXPECT_GE(collected().size(), acknowledged);
  // The fleet does not know which report arrived last, and repeats all of them.
  const auto stub = v1::OutcomeService::NewStub(server().channel());
  for (const v1::ReportOutcomesRequest& report : reports) {
    EXPECT_EQ(Refusal(*stub, report), "");
  }
  EXPECT_EQ(collected().size(), reports.size());
  // Targets of one scene are one event, of which one is among the surprising outcomes.
  const std::string page = MetricsPage(server());
  const std::string metric = "maneuver_outcome_collected_recordings{part=";
  const double surprising = ValueOf(page, metric + "\"surprising\"}");
  EXPECT_EQ(surprising, static_cast<double>(trained_->unseen().size()));
  EXPECT_EQ(surprising + ValueOf(page, metric + "\"sample\"}"),
            static_cast<double>(reports.size()));
  EXPECT_THAT(Run({"outcomes", "collect", "killed"}),
              HasSubstr("datasets/killed: " + std::to_string(reports.size()) + " recordings"));
  EXPECT_THAT(Run({"outcomes", "collect", "killed"}, /*status=*/1), HasSubstr("exists"));
}

TEST_F(OutcomesTest, AStreamThatAKillBreaksLosesAndRepeatsNothing) {
  const auto collected = [this] { return CollectedIn(trained_->data_dir() / "outcomes"); };
  Run({"outcomes", "collect", "before-stream", "--forget"}, collected().empty() ? 1 : 0);
  std::vector<v1::ReportOutcomesRequest> reports = ReportsOf(trained_->unseen());
  ASSERT_GT(reports.size(), 20u);
  for (size_t i = 0; i < reports.size(); ++i) reports[i].set_request_id(std::to_string(i));
  // Sends reports from `first` to `end`, and counts the answers. Calls `on_answer` after each.
  const auto stream = [&](size_t first, size_t end,
                          const std::function<void(size_t answers)>& on_answer) {
    grpc::ClientContext context;
    const auto call = v1::OutcomeService::NewStub(server().channel())->StreamOutcomes(&context);
    std::jthread writer([&] {
      v1::StreamOutcomesRequest request;
      for (size_t i = first; i < end; ++i) {
        *request.mutable_report() = reports[i];
        if (!call->Write(request)) return;
      }
      if (end == reports.size()) call->WritesDone();
    });
    size_t answers = 0;
    for (v1::StreamOutcomesResponse answer; call->Read(&answer);) {
      EXPECT_EQ(answer.request_id(), reports[first + answers].request_id());
      EXPECT_FALSE(answer.has_error()) << answer.error().message();
      on_answer(++answers);
    }
    writer.join();
    return std::pair(answers, call->Finish());
  };
  const auto [answered, break_off] = stream(0, 15, [this](size_t answers) {
    if (answers == 7) server().Kill();
  });
  ASSERT_GE(answered, 7u);
  EXPECT_EQ(break_off.error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_GE(collected().size(), answered);
  trained_->Restart();
  const auto [rest, end_of_rest] = stream(answered, reports.size(), [](size_t) {});
  EXPECT_TRUE(end_of_rest.ok()) << end_of_rest.error_message();
  EXPECT_EQ(rest, reports.size() - answered);
  EXPECT_EQ(collected().size(), reports.size());
  EXPECT_EQ(Counted("scored"), static_cast<double>(rest));
  // A stream whose end is lost, but not the server: what is sent again is counted once.
  EXPECT_EQ(stream(answered, reports.size(), [](size_t) {}).first, rest);
  EXPECT_EQ(Counted("scored"), static_cast<double>(rest));
}

TEST_F(OutcomesTest, AKeptAnswerIsScoredOnceThoughItsReportIsSentAgain) {
  const v1::Scenario& scene = trained_->unseen()[1];
  v1::PredictRequest asked;
  asked.set_model("models/tiny");
  *asked.add_scenarios() = scene;
  grpc::ClientContext asking;
  v1::PredictResponse answer;
  ASSERT_TRUE(
      v1::PredictionService::NewStub(server().channel())->Predict(&asking, asked, &answer).ok());
  v1::ReportOutcomesRequest report = ReportsOf({scene}).at(0);
  report.set_request_id("of a planner");
  report.mutable_outcomes(0)->clear_scenario();
  report.mutable_outcomes(0)->set_scenario_id(scene.scenario_id());
  report.mutable_outcomes(0)->set_prediction_time(scene.prediction_time());
  const auto stub = v1::OutcomeService::NewStub(server().channel());
  const double scored = Counted("scored");
  EXPECT_EQ(Refusal(*stub, report), "");
  EXPECT_EQ(Refusal(*stub, report), "");
  EXPECT_EQ(Counted("scored") - scored, 1.0);
  report.clear_request_id();
  EXPECT_THAT(Refusal(*stub, report), HasSubstr("not scored yet"));
}

TEST_F(OutcomesTest, CountsATargetThatIsFasterThanAllThatTheModelWasTrainedOn) {
  v1::GetModelVersionRequest request;
  request.set_name("models/tiny/versions/1");
  v1::ModelVersion version;
  grpc::ClientContext context;
  const auto found =
      v1::ModelService::NewStub(server().channel())->GetModelVersion(&context, request, &version);
  ASSERT_TRUE(found.ok()) << found.error_message();
  ASSERT_EQ(version.manifest().input_ranges_size(), 3);
  const v1::ValueRange& trained = version.manifest().input_ranges().at("speed");
  EXPECT_THAT(Run({"model", "show", "tiny/1"}), HasSubstr("held-out inputs"));
  const auto outside = [this] {
    return std::max(0.0, ValueOf(MetricsPage(server()),
                                 "maneuver_outcome_outside_training_total{input=\"speed\","
                                 "model_version=\"tiny/1\"}"));
  };
  const auto stub = v1::OutcomeService::NewStub(server().channel());
  // A target within the range, and then twice the highest speed.
  for (v1::ReportOutcomesRequest report : ReportsOf(trained_->unseen())) {
    v1::Outcome& outcome = *report.mutable_outcomes(0);
    outcome.set_model("models/tiny/versions/1");
    v1::TargetOutcome& target = *outcome.mutable_targets(0);
    auto& agents = *outcome.mutable_scenario()->mutable_agents();
    v1::Agent& agent = *std::find_if(agents.begin(), agents.end(), [&](const v1::Agent& each) {
      return each.id() == target.target_id();
    });
    const double speed = SpeedAt(agent, outcome.scenario().prediction_time());
    if (speed < 5.0 || speed > 0.9 * trained.high()) continue;
    const double before = outside();
    EXPECT_EQ(Refusal(*stub, report), "");
    EXPECT_EQ(outside(), before);
    Accelerate(2.0 * trained.high() / speed, *agent.mutable_states());
    Accelerate(2.0 * trained.high() / speed, *target.mutable_states());
    EXPECT_EQ(Refusal(*stub, report), "");
    EXPECT_EQ(outside(), before + 1.0);
    return;
  }
  FAIL() << "no target is within the range";
}

TEST_F(OutcomesTest, CollectedOutcomesRecalibrateAndTrain) {
  Report("datasets/unseen");
  Run({"outcomes", "collect", "happened"});
  const std::string recalibrated = Run(
      {"recalibrate", "tiny", "--dataset", "happened", "--set", "examples.validation_share=0.3"});
  EXPECT_THAT(recalibrated, HasSubstr("models/tiny/versions/2 was recalibrated in"));
  EXPECT_THAT(recalibrated, HasSubstr("tiny/2 was not promoted"));
  const std::string version = Run({"model", "show", "tiny/2", "--output", "json"});
  EXPECT_THAT(version, HasSubstr("\"startFrom\": \"models/tiny/versions/1\""));
  EXPECT_THAT(Run({"job", "list"}), HasSubstr("recalibrate"));
  const std::string trained =
      Run({"train", "tiny", "--start-from", "tiny/2", "--dataset", "town", "--dataset", "happened",
           "--settings", trained_->settings().string(), "--epochs", "1", "--promote", "never"});
  EXPECT_THAT(trained, HasSubstr("models/tiny/versions/3 was trained in"));
}

TEST_F(OutcomesTest, RefusesReportsThatAreEmptyOrTooLarge) {
  const auto stub = v1::OutcomeService::NewStub(server().channel());
  v1::ReportOutcomesRequest request;
  v1::ReportOutcomesResponse response;
  const double invalid = Counted("invalid");
  {
    grpc::ClientContext context;
    const auto status = stub->ReportOutcomes(&context, request, &response);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    EXPECT_THAT(status.error_message(), HasSubstr("outcomes"));
  }
  for (int i = 0; i < 257; ++i) request.add_outcomes()->add_targets();
  grpc::ClientContext context;
  const auto status = stub->ReportOutcomes(&context, request, &response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(status.error_message(), HasSubstr("at most 256"));
  EXPECT_EQ(Counted("invalid"), invalid);  // nothing of it was looked at
}

}  // namespace
}  // namespace maneuver::integration::outcomes_test
