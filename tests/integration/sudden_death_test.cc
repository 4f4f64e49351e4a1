// Kills the trainer and the server with SIGKILL: everything that was acknowledged must still exist.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <memory>
#include <string>

#include "maneuver/v1/dataset_service.grpc.pb.h"
#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "maneuver/v1/training_service.grpc.pb.h"
#include "tests/integration/trained_server.h"

namespace maneuver::integration::sudden_death_test {
namespace {

using ::testing::HasSubstr;

class SuddenDeathTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { trained_ = std::make_unique<TrainedServer>(); }
  static void TearDownTestSuite() { trained_.reset(); }

  static ServerProcess& server() { return trained_->server(); }

  // Starts a job that trains far longer than the test.
  static std::string StartLongJob() {
    std::string output;
    const int status = RunManeuver(
        server(),
        {"--output", "json", "train", "long", "--dataset", "town", "--settings",
         trained_->settings().string(), "--set", "optimization.joint_epochs=5000", "--detach"},
        &output);
    EXPECT_EQ(status, 0) << output;
    const size_t begin = output.find("jobs/");
    return output.substr(begin, output.find('"', begin) - begin);
  }

  static v1::Job GetJob(const std::string& name) {
    auto service = v1::TrainingService::NewStub(server().channel());
    grpc::ClientContext context;
    v1::GetJobRequest request;
    request.set_name(name);
    v1::Job job;
    const grpc::Status status = service->GetJob(&context, request, &job);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return job;
  }

  static void CancelAndWait(const std::string& job) {
    std::string output;
    EXPECT_EQ(RunManeuver(server(), {"job", "cancel", job}, &output), 0) << output;
    EXPECT_TRUE(WaitFor([&] { return GetJob(job).state() == v1::JOB_STATE_CANCELLED; },
                        std::chrono::seconds(15)));
  }

  static bool WaitForProgress(const std::string& name) {
    return WaitFor([&] { return GetJob(name).progress().sequence() > 1; },
                   std::chrono::seconds(60));
  }

  static bool Predicts() {
    auto service = v1::PredictionService::NewStub(server().channel());
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(10));
    v1::PredictRequest request;
    request.set_model("models/tiny");
    *request.add_scenarios() = trained_->unseen()[0];
    v1::PredictResponse response;
    const grpc::Status status = service->Predict(&context, request, &response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return status.ok() && response.predictions(0).targets(0).probabilities_size() == 12;
  }

  static std::unique_ptr<TrainedServer> trained_;
};

std::unique_ptr<TrainedServer> SuddenDeathTest::trained_;

TEST_F(SuddenDeathTest, AKilledTrainerInterruptsItsJobButNotPredictions) {
  const std::string job = StartLongJob();
  ASSERT_TRUE(WaitForProgress(job));
  EXPECT_TRUE(Predicts());
  const std::vector<pid_t> trainers = server().Trainers();
  ASSERT_EQ(trainers.size(), 1u);
  kill(trainers[0], SIGKILL);
  EXPECT_TRUE(Predicts());
  ASSERT_TRUE(
      WaitFor([&] { return GetJob(job).progress().attempt() == 2; }, std::chrono::seconds(60)));
  EXPECT_THAT(GetJob(job).error().message(), HasSubstr("kill"));
  EXPECT_TRUE(Predicts());
  CancelAndWait(job);
}

TEST_F(SuddenDeathTest, AKilledServerLosesNothingAndContinuesItsJob) {
  const std::string job = StartLongJob();
  ASSERT_TRUE(WaitForProgress(job));
  const std::vector<pid_t> trainers = server().Trainers();
  ASSERT_EQ(trainers.size(), 1u);
  server().Kill();
  EXPECT_TRUE(WaitFor([&] { return kill(trainers[0], 0) != 0; }, std::chrono::seconds(10)))
      << "the trainer outlived its server";
  trained_->Restart();

  EXPECT_TRUE(Predicts());
  EXPECT_TRUE(
      WaitFor([&] { return GetJob(job).progress().attempt() == 2; }, std::chrono::seconds(60)));
  EXPECT_THAT(GetJob(job).error().message(), HasSubstr("server"));

  auto training = v1::TrainingService::NewStub(server().channel());
  grpc::ClientContext context;
  v1::ListJobsResponse jobs;
  ASSERT_TRUE(training->ListJobs(&context, {}, &jobs).ok());
  int succeeded = 0;
  for (const v1::Job& each : jobs.jobs()) {
    if (each.state() != v1::JOB_STATE_SUCCEEDED) continue;
    ++succeeded;
    EXPECT_EQ(each.model_version(), "models/tiny/versions/1");
  }
  EXPECT_EQ(succeeded, 1);

  auto datasets = v1::DatasetService::NewStub(server().channel());
  grpc::ClientContext dataset_context;
  v1::ListDatasetsResponse listed;
  ASSERT_TRUE(datasets->ListDatasets(&dataset_context, {}, &listed).ok());
  ASSERT_EQ(listed.datasets_size(), 2);
  EXPECT_EQ(listed.datasets(0).recordings(), 60);
  CancelAndWait(job);
}

TEST_F(SuddenDeathTest, CancellingStopsTheTrainerWithinSecondsAndResumingContinues) {
  const std::string job = StartLongJob();
  ASSERT_TRUE(WaitForProgress(job));
  ASSERT_TRUE(
      WaitFor([&] { return GetJob(job).progress().step() > 20; }, std::chrono::seconds(60)));
  CancelAndWait(job);
  EXPECT_TRUE(WaitFor([] { return server().Trainers().empty(); }, std::chrono::seconds(15)));
  const v1::JobProgress before = GetJob(job).progress();

  std::string output;
  EXPECT_EQ(RunManeuver(server(), {"job", "resume", job, "--detach"}, &output), 0) << output;
  EXPECT_THAT(output, HasSubstr(job + " is pending"));
  ASSERT_TRUE(WaitFor(
      [&] {
        const v1::JobProgress now = GetJob(job).progress();
        return now.attempt() == 2 && now.phase() != "load" && now.step() > 1;
      },
      std::chrono::seconds(60)));
  // Steps and event numbers continue from the checkpoint that the cancellation wrote.
  EXPECT_GE(GetJob(job).progress().step(), before.step());
  EXPECT_GT(GetJob(job).progress().sequence(), before.sequence());
  CancelAndWait(job);
}

}  // namespace
}  // namespace maneuver::integration::sudden_death_test
