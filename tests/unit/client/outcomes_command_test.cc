// Which recordings maneuver outcomes report takes.

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <string>

#include "client/cli/command.h"
#include "maneuver/v1/dataset_service.grpc.pb.h"
#include "maneuver/v1/model_service.grpc.pb.h"
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

TEST(OutcomesCommandTest, ADatasetOfTheServerPrecedesAFolderOfThatPath) {
  Models models;
  Datasets datasets;
  int port = 0;
  const auto server = grpc::ServerBuilder()
                          .AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port)
                          .RegisterService(&models)
                          .RegisterService(&datasets)
                          .BuildAndStart();
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

}  // namespace
}  // namespace maneuver::cli::outcomes_command_test
