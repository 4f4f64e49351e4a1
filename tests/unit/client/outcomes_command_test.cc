// Which recordings maneuver outcomes report takes, and Ctrl-C while it waits.

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <string>
#include <thread>

#include "client/cli/command.h"
#include "maneuver/v1/dataset_service.grpc.pb.h"
#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/outcome_service.grpc.pb.h"
#include "model/data/dataset_folder.h"
#include "tests/unit/client/run_maneuver.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::cli::outcomes_command_test {
namespace {

using testing::HasSubstr;

class Models final : public v1::ModelService::Service {
  grpc::Status GetModelVersion(grpc::ServerContext*, const v1::GetModelVersionRequest*,
                               v1::ModelVersion* response) override {
    response->set_name("models/town/versions/1");
    return grpc::Status::OK;
  }
};

class Datasets final : public v1::DatasetService::Service {
 public:
  std::string asked;  // the dataset of the last call

 private:
  grpc::Status ListScenarios(grpc::ServerContext*, const v1::ListScenariosRequest* request,
                             v1::ListScenariosResponse*) override {
    asked = request->parent();
    return {grpc::StatusCode::NOT_FOUND, "there is no such dataset"};
  }
};

// Presses Ctrl-C once a report has arrived, and never answers it.
class SilentOutcomes final : public v1::OutcomeService::Service {
  grpc::Status StreamOutcomes(
      grpc::ServerContext* context,
      grpc::ServerReaderWriter<v1::StreamOutcomesResponse, v1::StreamOutcomesRequest>* stream)
      override {
    v1::StreamOutcomesRequest request;
    stream->Read(&request);
    kill(getpid(), SIGINT);
    while (!context->IsCancelled()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return grpc::Status::CANCELLED;
  }
};

std::unique_ptr<grpc::Server> Serve(Models& models, grpc::Service& other, int* port) {
  return grpc::ServerBuilder()
      .AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), port)
      .RegisterService(&models)
      .RegisterService(&other)
      .BuildAndStart();
}

TEST(OutcomesCommandTest, CtrlCEndsTheWaitForAnAnswer) {
  Models models;
  SilentOutcomes outcomes;
  int port = 0;
  const auto server = Serve(models, outcomes, &port);
  std::signal(SIGINT, SIG_DFL);  // whatever the shell has set
  const Result result =
      Maneuver({"--server", "127.0.0.1:" + std::to_string(port), "--timeout", "20", "outcomes",
                "report", "-", "--model", "town", "--kept"},
               R"({"scenarioId": "drive", "predictionTime": 1, "targetIds": [7]})");
  EXPECT_EQ(result.status, kFailed);
  EXPECT_EQ(result.err, "maneuver: interrupted\n");  // not: did not answer in time
  server->Shutdown(std::chrono::system_clock::now());
}

TEST(OutcomesCommandTest, ADatasetOfTheServerPrecedesAFolderOfThatPath) {
  Models models;
  Datasets datasets;
  int port = 0;
  const auto server = Serve(models, datasets, &port);
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "datasets");
  auto writer = data::DatasetWriter::Create(folder / "datasets/town", "a test");
  ASSERT_TRUE((*writer)->Add(data::SmallRecording("r0")).ok());
  ASSERT_TRUE((*writer)->Commit().ok());
  const std::filesystem::path before = std::filesystem::current_path();
  std::filesystem::current_path(folder.path());
  const Result result = Maneuver({"--server", "127.0.0.1:" + std::to_string(port), "outcomes",
                                  "report", "datasets/town", "--model", "town"});
  std::filesystem::current_path(before);
  EXPECT_EQ(result.status, kFailed);
  EXPECT_THAT(result.err, HasSubstr("there is no such dataset"));
  EXPECT_EQ(datasets.asked, "datasets/town");
  server->Shutdown(std::chrono::system_clock::now());
}

TEST(OutcomesCommandTest, AMistypedFileIsNoDatasetOfTheServer) {
  Models models;
  Datasets datasets;
  int port = 0;
  const auto server = Serve(models, datasets, &port);
  const Result result = Maneuver({"--server", "127.0.0.1:" + std::to_string(port), "outcomes",
                                  "report", "nowhere/scene.json", "--model", "town"});
  EXPECT_EQ(result.status, kFailed);
  EXPECT_EQ(result.err, "maneuver: nowhere/scene.json does not exist\n");
  EXPECT_EQ(datasets.asked, "");
  server->Shutdown(std::chrono::system_clock::now());
}

}  // namespace
}  // namespace maneuver::cli::outcomes_command_test
