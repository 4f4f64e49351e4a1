// Tests a server whose disk fills up: it keeps serving, refuses what it cannot store and says why,
// and continues a job once there is room.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/mount.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "maneuver/v1/training_service.grpc.pb.h"
#include "model/artifact/model_folder.h"
#include "tests/integration/server_process.h"
#include "tests/integration/trained_server.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/model/inference/reference_model.h"

namespace maneuver::integration::disk_full_test {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

class DiskFullTest : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directory(data_dir());
    // Mounts a disk that only this process and its children see. Uploads leave 64 MB free.
    if (unshare(CLONE_NEWNS) != 0 ||
        mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
        mount("tmpfs", data_dir().c_str(), "tmpfs", 0, "size=100m,nr_inodes=5000") != 0) {
      GTEST_SKIP() << "cannot mount a small disk here: " << std::strerror(errno);
    }
    mounted_ = true;
    fs::create_directories(data_dir() / "models" / "tiny");
    WriteTinyModel(data_dir() / "models" / "tiny" / "1", 1);
    std::ofstream(folder_.path() / "tiny.json") << kTinySettings;
    WriteTown(folder_.path() / "town", 1, 24, nullptr);
    server_ = std::make_unique<ServerProcess>(
        data_dir(), std::vector<std::string>{"--checkpoint-interval", "0.1"});
    ASSERT_THAT(Maneuver({"dataset", "upload", folder_.path() / "town", "town"}),
                HasSubstr("24 recordings"));
  }

  void TearDown() override {
    server_.reset();
    if (mounted_) umount2(data_dir().c_str(), MNT_DETACH);
  }

  static void WriteTinyModel(const fs::path& folder, int seed) {
    artifact::StoredModel model =
        inference::RandomModel(artifact::TinyModel().manifest.spec(), seed);
    for (int i = 0; i < model.manifest.spec().actions(); ++i) {
      model.manifest.add_actions()->set_action_id(i);
    }
    ASSERT_TRUE(artifact::WriteModelFolder(folder, model).ok());
  }

  fs::path data_dir() const { return folder_.path() / "data"; }

  // Runs `maneuver` and returns its output; the exit status is in status_.
  std::string Maneuver(const std::vector<std::string>& arguments) {
    std::string output;
    status_ = RunManeuver(*server_, arguments, &output);
    return output;
  }

  // Runs `maneuver`, which must fail, and returns its error, with the reason on the wire.
  std::string Refused(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"--output", "json"});
    const std::string output = Maneuver(arguments);
    EXPECT_EQ(status_, 1) << output;
    return output;
  }

  std::vector<std::string> Train(const std::string& model) const {
    return {"train",
            model,
            "--dataset",
            "town",
            "--settings",
            folder_.path() / "tiny.json",
            "--pretraining-epochs",
            "4",
            "--mixture-epochs",
            "3",
            "--epochs",
            "1",
            "--set",
            "examples.max_examples=300",
            "--detach"};
  }

  static std::vector<std::string> Tag() {
    return {"tag", "town", "--model", "tiny/1", "--on-server", "june"};
  }

  // Leaves room for no byte, and for no new file or folder.
  void FillDisk() const {
    fs::create_directory(data_dir() / "ballast");
    std::ofstream ballast(data_dir() / "ballast" / "bytes", std::ios::binary);
    for (const size_t piece : {size_t{1} << 20, size_t{1} << 12}) {
      const std::string bytes(piece, 'x');
      while (ballast.write(bytes.data(), static_cast<std::streamsize>(piece)).flush()) {
      }
      ballast.clear();
    }
    ASSERT_EQ(fs::space(data_dir()).available, 0u);
    for (int i = 0; std::ofstream(data_dir() / "ballast" / std::to_string(i)).is_open(); ++i) {
    }
  }

  v1::Job GetJob(const std::string& name) {
    auto service = v1::TrainingService::NewStub(server_->channel());
    grpc::ClientContext context;
    v1::GetJobRequest request;
    request.set_name(name);
    v1::Job job;
    const grpc::Status status = service->GetJob(&context, request, &job);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return job;
  }

  bool Predicts() {
    v1::PredictRequest request;
    request.set_model("models/tiny/versions/1");
    v1::Scenario& scenario = *request.add_scenarios();
    scenario.set_prediction_time(0.0);
    scenario.add_target_ids(7);
    v1::Agent& agent = *scenario.add_agents();
    agent.set_id(7);
    agent.set_type(v1::AGENT_TYPE_VEHICLE);
    agent.set_length(4.5);
    agent.set_width(1.9);
    agent.add_states()->set_velocity_x(5.0);
    auto service = v1::PredictionService::NewStub(server_->channel());
    grpc::ClientContext context;
    v1::PredictResponse response;
    const grpc::Status status = service->Predict(&context, request, &response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return status.ok() && response.predictions(0).targets(0).probabilities_size() > 0;
  }

  // Points further aliases to tiny/1 until there is no room for one more, and returns that error.
  // Some fit into pages that the store already has.
  std::string PromoteUntilRefused() {
    std::string output;
    status_ = 0;
    for (int i = 0; i < 200 && status_ == 0; ++i) {
      output = Maneuver({"--output", "json", "model", "promote", "tiny/1", "--alias",
                         "candidate-" + std::to_string(i) + std::string(50, 'x')});
    }
    EXPECT_EQ(status_, 1) << output;
    return output;
  }

  std::vector<std::string> Temporaries() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::recursive_directory_iterator(data_dir())) {
      const std::string name = entry.path().filename();
      if (name.find(".tmp-") != std::string::npos) names.push_back(name);
    }
    return names;
  }

  TemporaryFolder folder_;
  bool mounted_ = false;
  std::unique_ptr<ServerProcess> server_;
  int status_ = 0;
};

TEST_F(DiskFullTest, LosesNothingAndContinuesTheJobOnceThereIsRoom) {
  const std::string started = Maneuver(Train("victim"));
  ASSERT_EQ(status_, 0) << started;
  const std::string job = started.substr(0, started.find('\n'));
  ASSERT_TRUE(WaitFor([&] { return GetJob(job).state() == v1::JOB_STATE_RUNNING; },
                      std::chrono::seconds(60)));
  FillDisk();

  // Predictions still work. Requests that need storage are refused.
  EXPECT_TRUE(Predicts());
  const auto says_full = AllOf(HasSubstr("full"), HasSubstr("DISK_FULL"));
  EXPECT_THAT(Refused(Train("another")), says_full);
  EXPECT_THAT(Maneuver({"dataset", "upload", folder_.path() / "town", "second"}),
              HasSubstr("delete datasets or models"));
  EXPECT_EQ(status_, 1);
  EXPECT_THAT(PromoteUntilRefused(), says_full);
  EXPECT_THAT(Refused({"model", "label", "tiny/1", "0", "turn"}), says_full);
  EXPECT_THAT(Refused(Tag()), says_full);
  EXPECT_TRUE(WaitFor([&] { return server_->Trainers().empty(); }, std::chrono::seconds(60)));
  EXPECT_TRUE(Predicts());

  // The job has failed by then. The server stores this as soon as there is room.
  fs::remove_all(data_dir() / "ballast");
  ASSERT_TRUE(WaitFor([&] { return GetJob(job).state() == v1::JOB_STATE_FAILED; },
                      std::chrono::seconds(60)))
      << GetJob(job).DebugString();
  EXPECT_THAT(GetJob(job).error().message(), HasSubstr("the disk is full; free some space"));
  EXPECT_THAT(Temporaries(), ::testing::IsEmpty());
  EXPECT_TRUE(GetJob(job).model_version().empty());

  Maneuver({"job", "resume", job});
  EXPECT_EQ(status_, 0);
  EXPECT_EQ(GetJob(job).state(), v1::JOB_STATE_SUCCEEDED) << GetJob(job).DebugString();
  EXPECT_THAT(Maneuver({"dataset", "upload", folder_.path() / "town", "second"}),
              HasSubstr("24 recordings"));
  Maneuver({"model", "promote", "tiny/1"});
  EXPECT_EQ(status_, 0);
  const std::string tagged = Maneuver(Tag());
  EXPECT_EQ(status_, 0) << tagged;
  EXPECT_TRUE(Predicts());
}

// But not the newest version of a model: that its number is taken must be stored.
TEST_F(DiskFullTest, DeletesOnAFullDisk) {
  WriteTinyModel(folder_.path() / "next", 2);
  EXPECT_THAT(Maneuver({"model", "push", folder_.path() / "next", "tiny"}), HasSubstr("tiny/2"));
  EXPECT_THAT(Maneuver({"tag", "town", "--model", "tiny/1", "--on-server", "june"}),
              HasSubstr("tags/june"));
  FillDisk();
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{"dataset", "delete", "town"},
        {"tags", "delete", "june"},
        {"model", "delete", "tiny/1"}}) {
    const std::string output = Maneuver(command);
    EXPECT_EQ(status_, 0) << output;
  }
  EXPECT_GT(fs::space(data_dir()).available, 0u);
  EXPECT_THAT(Temporaries(), ::testing::IsEmpty());
}

}  // namespace
}  // namespace maneuver::integration::disk_full_test
