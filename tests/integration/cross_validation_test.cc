// Runs a cross-validation as a job of a real server that is killed meanwhile.

#include <gmock/gmock.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "maneuver/v1/training_service.pb.h"
#include "tests/integration/trained_server.h"

namespace maneuver::integration::cross_validation_test {
namespace {

namespace fs = std::filesystem;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;

TEST(CrossValidationTest, MeasuresEachRecordingOnceEvenIfTheServerIsKilled) {
  TemporaryFolder folder;
  const fs::path data = folder.path() / "data";
  fs::create_directory(data);
  std::ofstream(folder.path() / "tiny.json") << kTinySettings;
  WriteTown(folder.path() / "town", 1, 16, nullptr);
  auto server = std::make_unique<ServerProcess>(data);
  const auto run = [&](const std::vector<std::string>& command, int status = 0) {
    std::string output;
    EXPECT_EQ(RunManeuver(*server, command, &output), status) << output;
    return output;
  };
  run({"dataset", "upload", (folder.path() / "town").string(), "town"});
  const std::vector<std::string> command = {
      "cross-validate", "town",
      "--settings",     (folder.path() / "tiny.json").string(),
      "--folds",        "2",
      "--seeds",        "7,8",
      "--set",          "optimization.joint_epochs=1",
      "--set",          "optimization.pretraining_epochs=1"};
  std::vector<std::string> too_many = command;
  too_many.insert(too_many.end(), {"--test-dataset", "nowhere"});
  EXPECT_THAT(run(too_many, 1), HasSubstr("datasets/nowhere"));

  std::vector<std::string> detached = command;
  detached.insert(detached.end(), {"--detach", "--output", "json"});
  v1::Job job;
  ASSERT_TRUE(google::protobuf::util::JsonStringToMessage(run(detached), &job).ok());
  const fs::path first = data / "jobs" / job.name().substr(5) / "checkpoints" / "checkpoint-1";
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(240);
  while (!fs::exists(first)) {
    ASSERT_LT(std::chrono::steady_clock::now(), deadline);
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  server->Kill();
  server = std::make_unique<ServerProcess>(data);

  const std::string table = run({"job", "watch", job.name()});
  EXPECT_THAT(table, HasSubstr("datasets/town cross-validated in"));
  EXPECT_THAT(table, HasSubstr("2 folds, training seeds 7, 8"));
  EXPECT_THAT(table, HasSubstr("AHEAD BY ade_1?"));
  const std::string json = run({"job", "show", job.name(), "--output", "json"});
  ASSERT_TRUE(google::protobuf::util::JsonStringToMessage(json, &job).ok()) << json;
  EXPECT_EQ(job.attempts().started(), 2);
  EXPECT_GE(job.attempts().checkpoint(), 1);  // where the second process went on from
  ASSERT_EQ(job.cross_validation().sets_size(), 1);
  const v1::CrossValidatedSet& set = job.cross_validation().sets(0);
  EXPECT_EQ(set.recordings(), 16);
  EXPECT_EQ(set.overall().metrics().at("ade_1").seed_values_size(), 2);
  EXPECT_THAT(run({"job", "list"}), ContainsRegex("cross-validate +- +succeeded"));
  EXPECT_THAT(run({"job", "list", "--output", "json"}),
              ::testing::Not(HasSubstr("crossValidation\"")));
  // The job publishes no version.
  EXPECT_FALSE(fs::exists(data / "models" / "town"));
}

}  // namespace
}  // namespace maneuver::integration::cross_validation_test
