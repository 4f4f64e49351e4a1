// Checks that a training job whose trainer and server are killed repeatedly ends with the same
// weights, to the bit, as an undisturbed one.
//
// MANEUVER_KILLS: number of kills during one job, 6 by default; more kills train more epochs.
// MANEUVER_KILL_SEED: decides when, and which process, 1 by default.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/training_service.grpc.pb.h"
#include "model/files/digest.h"
#include "tests/integration/server_process.h"
#include "tests/integration/trained_server.h"

namespace maneuver::integration::durable_training_test {
namespace {

namespace fs = std::filesystem;

// Writes checkpoints often enough for processes that live a second.
const std::vector<std::string> kFlags = {"--checkpoint-interval", "0.1", "--job-attempts",
                                         "100000"};

int FromEnvironment(const char* name, int unset) {
  const char* value = std::getenv(name);
  return value == nullptr ? unset : std::atoi(value);
}

// A server that holds datasets/town, and may be killed.
class DurableTrainingTest : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directory(data_dir());
    std::ofstream(folder_.path() / "tiny.json") << kTinySettings;
    WriteTown(folder_.path() / "town", 1, 24, nullptr);
    Restart();
    std::string output;
    ASSERT_EQ(
        RunManeuver(server(), {"dataset", "upload", folder_.path() / "town", "town"}, &output), 0)
        << output;
  }

  fs::path data_dir() const { return folder_.path() / "data"; }
  ServerProcess& server() { return *server_; }
  void Restart() {
    server_.reset();
    server_ = std::make_unique<ServerProcess>(data_dir(), kFlags);
  }

  // All phases are short. More epochs leave more time for kills.
  std::string Start(const std::string& model, int joint_epochs, int ranks = 0) {
    std::string output;
    const int status =
        RunManeuver(server(),
                    {"--output", "json", "train", model, "--dataset", "town", "--settings",
                     (folder_.path() / "tiny.json").string(), "--pretraining-epochs", "4",
                     "--mixture-epochs", "3", "--epochs", std::to_string(joint_epochs), "--set",
                     "examples.max_examples=400", "--ranks", std::to_string(ranks), "--detach"},
                    &output);
    EXPECT_EQ(status, 0) << output;
    const size_t begin = output.find("jobs/");
    return output.substr(begin, output.find('"', begin) - begin);
  }

  v1::Job GetJob(const std::string& name) {
    auto service = v1::TrainingService::NewStub(server().channel());
    grpc::ClientContext context;
    v1::GetJobRequest request;
    request.set_name(name);
    v1::Job job;
    const grpc::Status status = service->GetJob(&context, request, &job);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return job;
  }
  static bool HasEnded(const v1::Job& job) {
    return job.state() != v1::JOB_STATE_PENDING && job.state() != v1::JOB_STATE_RUNNING;
  }
  v1::Job WaitForEnd(const std::string& name) {
    EXPECT_TRUE(WaitFor([&] { return HasEnded(GetJob(name)); }, std::chrono::seconds(1'200)));
    return GetJob(name);
  }

  fs::path Version(const std::string& model) { return data_dir() / "models" / model / "1"; }
  std::string Weights(const std::string& model) {
    const auto digest = files::Sha256OfFile(Version(model) / "weights.safetensors");
    EXPECT_TRUE(digest.ok()) << digest.status();
    return digest.value_or("");
  }

  double Fraction(const std::string& name) { return GetJob(name).progress().fraction(); }
  // Returns whether a process of the job is learning and has restored the previous process's
  // checkpoint.
  bool Learns(const std::string& name) {
    const v1::Job job = GetJob(name);
    return job.progress().attempt() == job.attempts().started() && job.progress().attempt() > 0 &&
           job.progress().phase() != "load";
  }

 private:
  TemporaryFolder folder_;
  std::unique_ptr<ServerProcess> server_;
};

TEST_F(DurableTrainingTest, AJobThatIsKilledRepeatedlyEndsWithTheSameWeights) {
  const int kills = FromEnvironment("MANEUVER_KILLS", 6);
  const int epochs = std::max(4, kills);
  std::mt19937 random(static_cast<unsigned>(FromEnvironment("MANEUVER_KILL_SEED", 1)));
  // The fractions of progress at which it is killed: spread over the whole learning.
  std::uniform_real_distribution<double> share(0.0, 0.7);
  std::vector<double> moments(static_cast<size_t>(kills));
  for (double& moment : moments) moment = share(random);
  std::ranges::sort(moments);
  std::uniform_real_distribution<double> longer(0.0, 0.5);  // seconds

  const auto begun = std::chrono::steady_clock::now();
  ASSERT_EQ(WaitForEnd(Start("whole", epochs)).state(), v1::JOB_STATE_SUCCEEDED);
  const auto whole = std::chrono::steady_clock::now();

  const std::string job = Start("killed", epochs);
  int of_trainers = 0;
  int of_servers = 0;
  double furthest = 0.0;
  while (of_trainers + of_servers < kills) {
    if (random() % 3 == 0) {  // before it learns: while it starts
      std::this_thread::sleep_for(std::chrono::duration<double>(longer(random)));
    } else {
      const double moment = moments[static_cast<size_t>(of_trainers + of_servers)];
      ASSERT_TRUE(
          WaitFor([&] { return (Learns(job) && Fraction(job) >= moment) || HasEnded(GetJob(job)); },
                  std::chrono::seconds(120)))
          << GetJob(job).DebugString();
    }
    ASSERT_FALSE(HasEnded(GetJob(job))) << GetJob(job).DebugString();
    furthest = std::max(furthest, Fraction(job));
    if (random() % 3 == 0) {
      server().Kill();
      ++of_servers;
      Restart();
    } else if (const std::vector<pid_t> trainers = server().Trainers(); !trainers.empty()) {
      kill(trainers[0], SIGKILL);
      ++of_trainers;
    }
  }
  const v1::Job ended = WaitForEnd(job);
  ASSERT_EQ(ended.state(), v1::JOB_STATE_SUCCEEDED) << ended.DebugString();
  EXPECT_EQ(Weights("killed"), Weights("whole"));
  EXPECT_GT(ended.attempts().started(), 1);
  EXPECT_FALSE(fs::exists(data_dir() / job / "checkpoints"));
  const auto seconds = [](auto duration) {
    return std::chrono::duration<double>(duration).count();
  };
  std::cout << "undisturbed " << seconds(whole - begun) << " s; killed "
            << seconds(std::chrono::steady_clock::now() - whole) << " s, with " << of_trainers
            << " deaths of the trainer and " << of_servers << " of the server, "
            << ended.attempts().started() << " processes, " << 100.0 * furthest
            << " % done at the furthest kill; " << ended.progress().sequence()
            << " events; weights " << Weights("killed") << "\n";
}

// Kills the server as soon as the version exists: before or just after the server records it.
// The processes that a process has started.
std::vector<pid_t> ChildrenOf(pid_t pid) {
  const std::string id = std::to_string(pid);
  std::ifstream file("/proc/" + id + "/task/" + id + "/children");
  std::vector<pid_t> children;
  for (pid_t child = 0; file >> child;) children.push_back(child);
  return children;
}

TEST_F(DurableTrainingTest, AJobOfTwoRanksOfWhichOneIsKilledEndsWithTheWeightsOfOneRank) {
  ASSERT_EQ(WaitForEnd(Start("one", 4, 1)).state(), v1::JOB_STATE_SUCCEEDED);
  const std::string job = Start("two", 4, 2);
  ASSERT_TRUE(
      WaitFor([&] { return Learns(job) && Fraction(job) >= 0.4; }, std::chrono::seconds(120)))
      << GetJob(job).DebugString();
  const std::vector<pid_t> launchers = server().Trainers();
  ASSERT_EQ(launchers.size(), 1U);
  const std::vector<pid_t> ranks = ChildrenOf(launchers[0]);
  ASSERT_EQ(ranks.size(), 2U);
  kill(ranks[1], SIGKILL);
  ASSERT_TRUE(WaitFor([&] { return GetJob(job).attempts().started() > 1 && Learns(job); },
                      std::chrono::seconds(120)))
      << GetJob(job).DebugString();
  server().Kill();
  Restart();
  const v1::Job ended = WaitForEnd(job);
  ASSERT_EQ(ended.state(), v1::JOB_STATE_SUCCEEDED) << ended.DebugString();
  EXPECT_EQ(Weights("two"), Weights("one"));
  EXPECT_GE(ended.attempts().started(), 3);
}

TEST_F(DurableTrainingTest, AServerKilledWhilePublishingMakesOneVersionAndFinishesTheJob) {
  const std::string job = Start("published", 1);
  ASSERT_TRUE(WaitFor([&] { return fs::exists(Version("published")); }, std::chrono::seconds(120)));
  server().Kill();
  Restart();
  const v1::Job ended = WaitForEnd(job);
  EXPECT_EQ(ended.state(), v1::JOB_STATE_SUCCEEDED) << ended.DebugString();
  EXPECT_EQ(ended.model_version(), "models/published/versions/1");
  EXPECT_FALSE(fs::exists(data_dir() / "models" / "published" / "2"));

  auto models = v1::ModelService::NewStub(server().channel());
  grpc::ClientContext context;
  v1::GetModelVersionRequest request;
  request.set_name("models/published/versions/1");
  v1::ModelVersion version;
  const grpc::Status status = models->GetModelVersion(&context, request, &version);
  ASSERT_TRUE(status.ok()) << status.error_message();
  // The first version of a model is promoted.
  EXPECT_THAT(version.aliases(), ::testing::ElementsAre("serving"));
}

}  // namespace
}  // namespace maneuver::integration::durable_training_test
