#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "client/cli/command.h"
#include "maneuver/v1/dataset_service.grpc.pb.h"
#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "maneuver/v1/training_service.grpc.pb.h"
#include "tests/unit/client/report/made_up_report.h"
#include "tests/unit/client/run_maneuver.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::cli::report_command_test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr char kVersion[] = "models/town/versions/3";

// A server with one version, its evaluation, and the job that trained it.
class Models final : public v1::ModelService::Service {
 public:
  std::atomic<bool> evaluated = true;

 private:
  grpc::Status GetModelVersion(grpc::ServerContext*, const v1::GetModelVersionRequest*,
                               v1::ModelVersion* response) override {
    *response = *report::MadeUpReport().version;
    v1::ModelSpec* spec = response->mutable_manifest()->mutable_spec();
    spec->set_actions(report::kMadeUpActions);
    spec->mutable_trajectory()->set_waypoints(report::kMadeUpWaypoints);
    spec->mutable_trajectory()->mutable_waypoint_interval()->set_nanos(500'000'000);
    spec->mutable_raster()->set_history_frames(3);
    spec->mutable_raster()->mutable_frame_interval()->set_nanos(500'000'000);
    v1::ExampleSettings* examples =
        response->mutable_manifest()->mutable_provenance()->mutable_settings()->mutable_examples();
    *examples = Examples();
    examples->set_validation_share(0.5);
    return grpc::Status::OK;
  }
  grpc::Status ListModelVersions(grpc::ServerContext*, const v1::ListModelVersionsRequest*,
                                 v1::ListModelVersionsResponse* response) override {
    for (const char* version : {"models/town/versions/4", kVersion}) {
      response->add_model_versions()->set_name(version);
    }
    return grpc::Status::OK;
  }
  grpc::Status GetActionSet(grpc::ServerContext*, const v1::GetActionSetRequest* request,
                            v1::ActionSet* response) override {
    *response = report::MadeUpActionSet(request->speed());
    return grpc::Status::OK;
  }
  grpc::Status ListEvaluationReports(grpc::ServerContext*,
                                     const v1::ListEvaluationReportsRequest* request,
                                     v1::ListEvaluationReportsResponse* response) override {
    if (evaluated) *response->add_evaluation_reports() = Evaluation(request->parent());
    return grpc::Status::OK;
  }
  grpc::Status GetEvaluationReport(grpc::ServerContext*,
                                   const v1::GetEvaluationReportRequest* request,
                                   v1::EvaluationReport* response) override {
    EXPECT_EQ(request->name(), std::string(kVersion) + "/evaluations/unseen");
    *response = Evaluation(kVersion);
    return grpc::Status::OK;
  }

  static v1::ExampleSettings Examples() {
    v1::ExampleSettings settings;
    settings.mutable_stride()->set_seconds(1);
    settings.set_keep_standing(1.0);
    return settings;
  }
  static v1::EvaluationReport Evaluation(const std::string& version) {
    v1::EvaluationReport evaluation = report::MadeUpEvaluation();
    evaluation.set_model_version(version);
    evaluation.set_name(version + "/evaluations/unseen");
    *evaluation.mutable_example_settings() = Examples();
    return evaluation;
  }
};

class Datasets final : public v1::DatasetService::Service {
 public:
  std::atomic<bool> gone = false;

 private:
  grpc::Status ListScenarios(grpc::ServerContext*, const v1::ListScenariosRequest*,
                             v1::ListScenariosResponse* response) override {
    if (gone) return {grpc::StatusCode::NOT_FOUND, "there is no such dataset"};
    for (int i = 0; i < 40; ++i) {
      response->add_scenarios()->set_scenario_id("recording " + std::to_string(i));
    }
    return grpc::Status::OK;
  }
  grpc::Status GetScenario(grpc::ServerContext*, const v1::GetScenarioRequest* request,
                           v1::Scenario* response) override {
    *response = *report::MadeUpRecording(request->scenario_id());
    return grpc::Status::OK;
  }
};

class Predictions final : public v1::PredictionService::Service {
 public:
  std::atomic<bool> answers_too_much = false;  // for scenes that nobody asked about

 private:
  grpc::Status Predict(grpc::ServerContext*, const v1::PredictRequest* request,
                       v1::PredictResponse* response) override {
    EXPECT_EQ(request->model(), kVersion);
    for (int i = 0; i < request->scenarios_size(); ++i) {
      const v1::Scenario& scenario = request->scenarios(i);
      for (const v1::Agent& agent : scenario.agents()) {  // the answer is not in the question
        EXPECT_LE(agent.states().rbegin()->time(), scenario.prediction_time() + 1e-6);
      }
      v1::ScenarioPrediction* prediction = response->add_predictions();
      prediction->set_scenario_index(i);
      *prediction->add_targets() = report::MadeUpScene(0, "").prediction;
    }
    for (const int index : {-1, request->scenarios_size()}) {
      if (!answers_too_much || request->scenarios_size() == 1) break;
      v1::ScenarioPrediction* prediction = response->add_predictions();
      prediction->set_scenario_index(index);
      prediction->add_targets();
    }
    return grpc::Status::OK;
  }
  grpc::Status ClassifyTrajectories(grpc::ServerContext*,
                                    const v1::ClassifyTrajectoriesRequest* request,
                                    v1::ClassifyTrajectoriesResponse* response) override {
    for (int i = 0; i < request->scenarios_size(); ++i) {
      v1::ScenarioClassification* answer = response->add_classifications();
      answer->set_scenario_index(i);
      v1::TargetClassification* target = answer->add_targets();
      for (int id = 0; id < report::kMadeUpActions; ++id) {
        target->add_responsibilities(id == 3 ? 1.0 : 0.0);
      }
    }
    if (answers_too_much) {
      v1::ScenarioClassification* answer = response->add_classifications();
      answer->set_scenario_index(request->scenarios_size());
      answer->add_targets();
    }
    return grpc::Status::OK;
  }
};

class Training final : public v1::TrainingService::Service {
 public:
  std::atomic<bool> forgotten = false;
  std::atomic<bool> started = false;
  std::atomic<bool> interrupts = false;  // takes trainings, and presses Ctrl-C once one is watched

 private:
  static v1::Job Job() {
    v1::Job job;
    job.set_name("jobs/abc");
    job.mutable_train()->set_model("models/town");
    job.set_state(v1::JOB_STATE_RUNNING);
    *job.mutable_progress() = report::MadeUpEpoch("joint", 2, 2);
    return job;
  }
  grpc::Status Train(grpc::ServerContext*, const v1::TrainRequest*, v1::Job* response) override {
    started = true;
    *response = Job();
    if (interrupts) return grpc::Status::OK;
    return {grpc::StatusCode::INVALID_ARGUMENT, "not here"};
  }
  grpc::Status Evaluate(grpc::ServerContext*, const v1::EvaluateRequest*, v1::Job*) override {
    started = true;
    return {grpc::StatusCode::INVALID_ARGUMENT, "not here"};
  }
  grpc::Status GetJob(grpc::ServerContext*, const v1::GetJobRequest* request,
                      v1::Job* response) override {
    *response = Job();
    if (request->name() == "jobs/cross") response->mutable_cross_validate();
    return grpc::Status::OK;
  }
  grpc::Status ListJobs(grpc::ServerContext*, const v1::ListJobsRequest*,
                        v1::ListJobsResponse* response) override {
    if (forgotten) return grpc::Status::OK;
    *response->add_jobs() = Job();
    response->mutable_jobs(0)->set_model_version(kVersion);
    return grpc::Status::OK;
  }
  // The job never ends: a command that waits for its end never returns.
  grpc::Status WatchJob(grpc::ServerContext* context, const v1::WatchJobRequest*,
                        grpc::ServerWriter<v1::WatchJobResponse>* writer) override {
    for (int epoch = 1; epoch <= 2; ++epoch) {
      v1::WatchJobResponse event;
      *event.mutable_job() = Job();
      *event.mutable_job()->mutable_progress() = report::MadeUpEpoch("joint", epoch, epoch);
      writer->Write(event);
    }
    if (interrupts) kill(getpid(), SIGINT);
    while (!context->IsCancelled()) absl::SleepFor(absl::Milliseconds(5));
    return grpc::Status::CANCELLED;
  }
};

class ReportCommandTest : public testing::Test {
 protected:
  ReportCommandTest() {
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    for (grpc::Service* service :
         std::initializer_list<grpc::Service*>{&models_, &datasets_, &predictions_, &training_}) {
      builder.RegisterService(service);
    }
    server_ = builder.BuildAndStart();
    address_ = "127.0.0.1:" + std::to_string(port);
  }
  ~ReportCommandTest() override { server_->Shutdown(std::chrono::system_clock::now()); }

  Result Run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"--server", address_});
    return Maneuver(arguments);
  }
  std::string File(const std::string& name) const { return (folder_ / name).string(); }
  std::string Read(const std::string& name) const {
    std::ostringstream text;
    text << std::ifstream(File(name), std::ios::binary).rdbuf();
    return text.str();
  }
  // What the page of this name shows.
  json Data(const std::string& name) const {
    const std::string page = Read(name);
    const std::string begin = R"(id="data">)";
    const size_t first = page.find(begin) + begin.size();
    return json::parse(page.substr(first, page.find("</script>", first) - first), nullptr, false);
  }

  Models models_;
  Datasets datasets_;
  Predictions predictions_;
  Training training_;
  std::unique_ptr<grpc::Server> server_;
  std::string address_;
  const TemporaryFolder folder_;
};

TEST_F(ReportCommandTest, ModelReportGathersAllPartsIntoOneFile) {
  const Result result = Run({"model", "report", "town/3", "--out", File("r.html")});
  ASSERT_EQ(result.status, kOk) << result.err;
  EXPECT_EQ(result.out, "");
  EXPECT_THAT(result.err, HasSubstr("r.html"));
  const json data = Data("r.html");
  ASSERT_FALSE(data.is_discarded());
  EXPECT_EQ(data["title"], "town/3");
  EXPECT_TRUE(data["missing"].empty()) << data["missing"];
  EXPECT_EQ(data["actions"]["speeds"], json({0.0, 5.0, 10.0, 20.0}));
  EXPECT_EQ(data["evaluation"]["examples"], 1'200);
  ASSERT_EQ(data["others"].size(), 1);
  EXPECT_EQ(data["others"][0]["version"], "models/town/versions/4");
  ASSERT_EQ(data["learning"].size(), 1);
  EXPECT_EQ(data["learning"][0]["epochs"], json({1, 2}));
  EXPECT_EQ(data["scenesFrom"], "datasets/unseen");
  ASSERT_GT(data["scenes"].size(), 3);
  for (const json& scene : data["scenes"]) {
    EXPECT_EQ(scene["q"][3], 1.0);
    EXPECT_NEAR(scene["surprise"].get<double>(), -std::log(0.0625), 0.001);  // p of action 3
    EXPECT_NEAR(scene["speed"].get<double>(), scene["target"] == "7" ? 10.0 : 0.0, 0.01);
  }
}

TEST_F(ReportCommandTest, IgnoresAnswersForScenesThatWereNotAskedAbout) {
  predictions_.answers_too_much = true;
  const Result result = Run({"model", "report", "town/3", "--out", File("report.html")});
  EXPECT_EQ(result.status, kOk) << result.err;
  EXPECT_FALSE(Data("report.html")["scenes"].empty());
}

TEST_F(ReportCommandTest, QuietKeepsTheProgressForPrograms) {
  const Result result =
      Run({"--quiet", "--progress", "json", "model", "report", "town/3", "--out", File("r.html")});
  ASSERT_EQ(result.status, kOk) << result.err;
  EXPECT_THAT(result.err, AllOf(HasSubstr("{\"progress\":"), Not(HasSubstr("the report is"))));
}

TEST_F(ReportCommandTest, WithoutAnEvaluationThePageSaysHowToGetOne) {
  models_.evaluated = false;
  ASSERT_EQ(Run({"model", "report", "town/3", "--out", File("r.html")}).status, kOk);
  const json data = Data("r.html");
  EXPECT_THAT(data["missing"]["evaluation"]["command"].get<std::string>(),
              HasSubstr("maneuver evaluate town/3 --dataset "));
  EXPECT_EQ(data["scenesFrom"], "datasets/town");
  EXPECT_GT(data["scenes"].size(), 0);
}

TEST_F(ReportCommandTest, NamesMissingDataAndShowsTheRest) {
  datasets_.gone = true;
  training_.forgotten = true;
  ASSERT_EQ(Run({"model", "report", "town/3", "--out", File("r.html")}).status, kOk);
  const json data = Data("r.html");
  EXPECT_EQ(data["missing"]["scenes"]["reason"], "there is no such dataset");
  EXPECT_THAT(data["missing"]["learning"]["reason"].get<std::string>(), HasSubstr("forgotten"));
  EXPECT_EQ(data["actions"]["list"].size(), report::kMadeUpActions);
}

TEST_F(ReportCommandTest, RefusesAnEvaluationThatDoesNotExist) {
  const Result result =
      Run({"model", "report", "town/3", "--dataset", "other", "--out", File("r.html")});
  EXPECT_EQ(result.status, kFailed);
  EXPECT_THAT(result.err, HasSubstr("maneuver evaluate town/3 --dataset other"));
  EXPECT_FALSE(std::filesystem::exists(File("r.html")));
}

TEST_F(ReportCommandTest, AReportOfARunningTrainingHasItsCurvesSoFar) {
  ASSERT_EQ(Run({"job", "report", "abc", "--out", File("r.html")}).status, kOk);
  const json data = Data("r.html");
  EXPECT_EQ(data["learning"][0]["epochs"], json({1, 2}));
  EXPECT_EQ(data["missing"]["scenes"]["command"], "maneuver job report abc");
}

TEST_F(ReportCommandTest, WritesCurvesWithoutAPage) {
  const Result result =
      Run({"job", "report", "abc", "--curves", File("c.csv"), "--tensorboard", File("runs")});
  ASSERT_EQ(result.status, kOk) << result.err;
  EXPECT_THAT(Read("c.csv"), AllOf(HasSubstr("phase,epoch,step,examples,term,value\n"),
                                   HasSubstr("joint,2,2,held-out,loss,2.25\n")));
  EXPECT_TRUE(std::filesystem::is_directory(folder_ / "runs" / "training"));
  EXPECT_FALSE(std::filesystem::exists("report.html"));
}

TEST_F(ReportCommandTest, CrossValidationsHaveNoReport) {
  const Result result = Run({"job", "report", "cross", "--out", File("r.html")});
  EXPECT_EQ(result.status, kFailed);
  EXPECT_THAT(result.err, HasSubstr("maneuver job show abc"));
}

TEST_F(ReportCommandTest, RefusesAnUnwritableFileBeforeStartingTheJob) {
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{"evaluate", "town", "--dataset", "unseen", "--report"},
        {"train", "town", "--dataset", "unseen", "--report"},
        {"train", "town", "--dataset", "unseen", "--curves"},
        {"train", "town", "--dataset", "unseen", "--tensorboard"},
        {"model", "report", "town", "--out"},
        {"job", "report", "abc", "--out"}}) {
    std::vector<std::string> arguments = command;
    arguments.push_back("/dev/null/folder/r");
    const Result result = Run(arguments);
    EXPECT_EQ(result.status, kUsage) << command.front();
    EXPECT_THAT(result.err, AllOf(HasSubstr("/dev/null/folder/r"), Not(HasSubstr("server"))));
    EXPECT_FALSE(training_.started);
  }
}

TEST_F(ReportCommandTest, CtrlCSaysHowToGetTheReportLater) {
  std::signal(SIGINT, SIG_DFL);  // whatever the shell has set
  training_.interrupts = true;
  const Result result =
      Run({"train", "town", "--dataset", "town", "--report", File("report.html")});
  EXPECT_EQ(result.status, kInterrupted) << result.err;
  EXPECT_THAT(result.err,
              HasSubstr("once it has ended: maneuver job report abc --out " + File("report.html")));
}

TEST_F(ReportCommandTest, ADetachedJobSaysHowToGetItsReportLater) {
  EXPECT_EQ(Run({"evaluate", "town", "--dataset", "unseen", "--detach", "--report", "r"}).status,
            kUsage);
  EXPECT_EQ(Run({"train", "town", "--dataset", "unseen", "--detach", "--curves", "c"}).status,
            kUsage);
  EXPECT_FALSE(training_.started);
}

}  // namespace
}  // namespace maneuver::cli::report_command_test
