// What becomes of jobs whose process or server dies, and of those that are resumed by request.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include "model/files/durable_file.h"
#include "server/errors/error_details.h"
#include "server/jobs/job_attempt.h"
#include "tests/unit/server/jobs/supervisor_fixture.h"

namespace maneuver::jobs::resumption_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

// A trainer that makes a checkpoint and then dies, as often as $deaths says; then it is done. What
// it found when it started goes to `found`.
std::string DiesSoOften(int deaths) {
  return "mkdir -p \"$checkpoints\"; n=$(ls \"$checkpoints\" | wc -l); echo $n >> "
         "\"${0%/*}/found\"\n"
         "echo '{\"phase\":\"joint\",\"epochReport\":{}}'\n"
         "[ $n -ge " +
         std::to_string(deaths) +
         " ] || { touch \"$checkpoints/checkpoint-00000$((n + 1))\"; echo dying >&2; kill -9 $$; "
         "}\n"
         "mkdir \"$output\"";
}

class ResumptionTest : public SupervisorTest {
 protected:
  // As a server leaves it that was killed, a thousand seconds after 1970.
  v1::Job LeaveRunning(const std::string& id, const JobEdit& change = {},
                       const std::optional<v1::JobProgress>& progress = std::nullopt) {
    v1::Job job;
    job.set_name("jobs/" + id);
    job.set_state(v1::JOB_STATE_PENDING);
    *job.mutable_train() = TrainTown();
    SupervisorTest::LeaveRunning(
        job,
        [&](v1::Job& begun) {
          BeginAttempt(begun, FolderOf(begun), absl::FromUnixSeconds(1'000));
          if (change) change(begun);
          job = begun;
        },
        progress);
    return job;
  }
  std::string Found() { return *files::ReadFile(folder_ / "found"); }
};

TEST_F(ResumptionTest, AJobWhoseProcessDiesContinuesFromItsCheckpoint) {
  Trainer(DiesSoOften(7));  // more often than it may without a checkpoint
  Start();
  const std::string name = Train().name();
  const v1::Job job = WaitForEnd(name);
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(Found(), "0\n1\n2\n3\n4\n5\n6\n7\n");
  EXPECT_EQ(job.attempts().started(), 8);
  EXPECT_EQ(job.attempts().without_progress(), 0);
  EXPECT_FALSE(job.has_error());
  EXPECT_THAT(job.last_lines(), SizeIs(0));
  EXPECT_THAT(versions_.promotions, SizeIs(1));
  // One process after another in one list of events; and what is done needs no checkpoints.
  const auto events = *store_->ListProgress(name, 0, 100);
  ASSERT_THAT(events, SizeIs(8));
  for (int i = 0; i < 8; ++i) EXPECT_EQ(events[static_cast<size_t>(i)].attempt(), i + 1);
  EXPECT_FALSE(fs::exists(FolderOf(job) / "checkpoints"));
}

TEST_F(ResumptionTest, FailsWithReasonAndLastLinesIfNoProcessGetsFurther) {
  Trainer("echo x >> \"${0%/*}/found\"; echo about to die >&2; kill -9 $$");
  SupervisorOptions options = Options();
  options.limits.attempts_without_progress = 3;
  StartWith(options);
  const v1::Job job = WaitForEnd(Train().name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(ReasonOf(job), "TRAINER_DIED");
  EXPECT_THAT(job.error().message(), HasSubstr("3 processes"));
  EXPECT_THAT(job.last_lines(), ElementsAre("about to die"));
  EXPECT_EQ(Found(), "x\nx\nx\n");
  // And the queue goes on.
  Trainer("mkdir \"$output\"");
  EXPECT_EQ(WaitForEnd(Train().name()).state(), v1::JOB_STATE_SUCCEEDED);
}

TEST_F(ResumptionTest, DoesNotRetryAFailureReportedByTheTrainer) {
  Trainer("echo x >> \"${0%/*}/found\"; exit 80");
  Start();
  EXPECT_EQ(ReasonOf(WaitForEnd(Train().name())), "TRAINING_DIVERGED");
  EXPECT_EQ(Found(), "x\n");
}

TEST_F(ResumptionTest, StoppingInterruptsTheJobWhichContinuesAtTheNextStart) {
  Trainer(
      "trap 'mkdir -p \"$checkpoints\"; touch \"$checkpoints/checkpoint-000001\"; exit 143' "
      "TERM; echo '{\"phase\":\"load\"}'; while :; do sleep 0.02; done");
  Start();
  const std::string running = Train().name();
  WaitForProgress(running);
  const std::string pending = Train().name();
  supervisor_->Stop();
  EXPECT_TRUE(supervisor_->IsStopped());
  const v1::Job job = *store_->Get(running);
  EXPECT_EQ(job.state(), v1::JOB_STATE_PENDING);
  EXPECT_EQ(ReasonOf(job), "SERVER_INTERRUPTED");
  EXPECT_FALSE(job.has_end_time());
  EXPECT_EQ(store_->Get(pending)->state(), v1::JOB_STATE_PENDING);
  EXPECT_TRUE(absl::IsUnavailable(supervisor_->Train(TrainTown()).status()));
  EXPECT_TRUE(absl::IsUnavailable(supervisor_->Resume(running).status()));

  Trainer(DiesSoOften(0));
  Start();
  EXPECT_EQ(WaitForEnd(running).state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(WaitForEnd(pending).state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(Found(), "1\n0\n");  // the older one first, with its checkpoint
}

TEST_F(ResumptionTest, AfterACrashJobsContinueAndLeftoversAreRemoved) {
  LeaveRunning("interrupted");
  for (const char* leftover : {"interrupted/output", "interrupted/.output.tmp-1",
                               "interrupted/checkpoints", "forgotten"}) {
    fs::create_directories(folder_ / "jobs" / leftover);
  }
  std::ofstream(folder_ / "jobs" / "interrupted" / "checkpoints" / "checkpoint-000003") << "";
  std::ofstream(folder_ / "jobs" / "interrupted" / "trainer.log") << "half";
  Trainer(DiesSoOften(0));
  Start();
  EXPECT_FALSE(fs::exists(folder_ / "jobs" / "forgotten"));
  const v1::Job job = WaitForEnd("jobs/interrupted");
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(Found(), "1\n");
  EXPECT_EQ(job.attempts().started(), 2);
  EXPECT_EQ(job.attempts().checkpoint(), 3);
  EXPECT_FALSE(fs::exists(FolderOf(job) / "output"));
  EXPECT_FALSE(fs::exists(FolderOf(job) / ".output.tmp-1"));
  EXPECT_TRUE(fs::exists(FolderOf(job) / "trainer.log"));
}

TEST_F(ResumptionTest, DoesNotPublishTwiceIfTheServerDiedAfterPublishing) {
  LeaveRunning("published", [](v1::Job& job) {
    job.mutable_attempts()->set_without_progress(100);  // even if it had come to its last attempt
  });
  versions_.published["jobs/published"] = {"town", 9};
  Trainer("exit 70");
  Start();
  const v1::Job job = WaitForEnd("jobs/published");
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(job.model_version(), "models/town/versions/9");
  EXPECT_THAT(versions_.promotions, SizeIs(0));
}

TEST_F(ResumptionTest, AModelIsRegisteredLaterIfTheStoreIsAwayAndNoAttemptIsUsedUp) {
  {
    const std::lock_guard lock(versions_.mutex);
    versions_.publish_error =
        errors::WithReason(absl::UnavailableError("the store is away"), "STORE_UNAVAILABLE");
  }
  SupervisorOptions options = Options();
  options.limits.attempts_without_progress = 1;
  StartWith(options);
  const v1::Job job = Train();
  WaitFor(job.name(), [](const v1::Job& j) { return j.attempts().started() > 3; });
  {
    const std::lock_guard lock(versions_.mutex);
    versions_.publish_error = absl::OkStatus();
  }
  const v1::Job ended = WaitForEnd(job.name());
  EXPECT_EQ(ended.state(), v1::JOB_STATE_SUCCEEDED) << ended.error().message();
  EXPECT_EQ(versions_.promotions.size(), 1u);
}

TEST_F(ResumptionTest, AJobThatIsDamagedWhileItRunsDoesNotKeepOthersFromRunning) {
  Trainer(
      "echo '{\"phase\":\"load\"}'; while [ ! -e \"${0%/*}/go\" ]; do sleep 0.02; done\n"
      "mkdir \"$output\"");
  Start();
  const std::string damaged = Train().name();
  WaitForProgress(damaged);
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open((folder_ / "maneuver.db").c_str(), &database), SQLITE_OK);
  sqlite3_busy_timeout(database, 10'000);
  const std::string statement = "UPDATE jobs SET job = x'00' WHERE name = '" + damaged + "'";
  EXPECT_EQ(sqlite3_exec(database, statement.c_str(), nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(database);
  std::ofstream(folder_ / "go") << "";
  EXPECT_EQ(WaitForEnd(Train().name()).state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_TRUE(absl::IsDataLoss(store_->Get(damaged).status()));
}

TEST_F(ResumptionTest, ServerCrashesCountAsAttemptsUnlessThereIsANewCheckpoint) {
  const auto died_so_often = [](v1::Job& job) { job.mutable_attempts()->set_without_progress(4); };
  LeaveRunning("stuck", died_so_often);
  LeaveRunning("going", died_so_often);
  fs::create_directories(folder_ / "jobs" / "going" / "checkpoints");
  std::ofstream(folder_ / "jobs" / "going" / "checkpoints" / "checkpoint-000001") << "";
  Start();
  const v1::Job stuck = WaitForEnd("jobs/stuck");
  EXPECT_EQ(stuck.state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(ReasonOf(stuck), "SERVER_INTERRUPTED");
  EXPECT_EQ(WaitForEnd("jobs/going").state(), v1::JOB_STATE_SUCCEEDED);
}

TEST_F(ResumptionTest, ACancellationSurvivesACrash) {
  Trainer(kIgnoresSigterm);
  SupervisorOptions options = Options();
  options.patience = std::chrono::milliseconds(300);
  StartWith(options);
  const std::string name = Train().name();
  WaitForProgress(name);
  ASSERT_TRUE(supervisor_->Cancel(name)->cancel_requested());
  // What a server that is killed now leaves in the store.
  const v1::Job left = *store_->Get(name);
  EXPECT_EQ(left.state(), v1::JOB_STATE_RUNNING);
  EXPECT_TRUE(left.cancel_requested());
  EXPECT_TRUE(absl::IsFailedPrecondition(supervisor_->Resume(name).status()));
  const v1::Job cancelled = WaitForEnd(name);
  EXPECT_FALSE(cancelled.cancel_requested());
  supervisor_.reset();

  LeaveRunning("left", [](v1::Job& job) { job.set_cancel_requested(true); });
  Start();
  const v1::Job job = *store_->Get("jobs/left");
  EXPECT_EQ(job.state(), v1::JOB_STATE_CANCELLED);
  EXPECT_TRUE(job.has_end_time() && !job.has_error() && !job.cancel_requested());
}

TEST_F(ResumptionTest, AServersDeathDoesNotStandWithTheLastLinesOfAnEarlierProcess) {
  const auto died_before = [](v1::Job& job) {
    job.mutable_error()->set_message("the trainer crashed");
    job.add_last_lines("about to die");
  };
  LeaveRunning("left", died_before);
  LeaveRunning("cancelled", [&](v1::Job& job) {
    died_before(job);
    job.set_cancel_requested(true);
  });
  SupervisorOptions options = Options();
  options.max_running_jobs = 0;
  StartWith(options);
  const v1::Job left = *store_->Get("jobs/left");
  EXPECT_EQ(ReasonOf(left), "SERVER_INTERRUPTED");
  EXPECT_THAT(left.last_lines(), SizeIs(0));
  const v1::Job cancelled = *store_->Get("jobs/cancelled");
  EXPECT_EQ(cancelled.state(), v1::JOB_STATE_CANCELLED);
  EXPECT_THAT(cancelled.last_lines(), SizeIs(0));
}

TEST_F(ResumptionTest, ACancelledJobKeepsItsCheckpointAndCanBeResumed) {
  Trainer("mkdir -p \"$checkpoints\"; touch \"$checkpoints/checkpoint-000001\"\n" +
          std::string(kRunsOn));
  Start();
  const std::string name = Train().name();
  const int64_t seen = WaitForProgress(name).progress().sequence();
  ASSERT_TRUE(supervisor_->Cancel(name).ok());
  EXPECT_EQ(WaitForEnd(name).state(), v1::JOB_STATE_CANCELLED);

  Trainer(DiesSoOften(0));
  const auto resumed = supervisor_->Resume(name);
  ASSERT_TRUE(resumed.ok()) << resumed.status();
  EXPECT_EQ(resumed->state(), v1::JOB_STATE_PENDING);
  EXPECT_FALSE(resumed->has_end_time());
  const v1::Job job = WaitForEnd(name);
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(Found(), "1\n");
  EXPECT_EQ(job.progress().sequence(), seen + 1);
  EXPECT_EQ(job.attempts().started(), 2);
  // What has SUCCEEDED is done.
  const absl::Status again = supervisor_->Resume(name).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(again)) << again;
  EXPECT_TRUE(absl::IsNotFound(supervisor_->Resume("jobs/none").status()));
}

TEST_F(ResumptionTest, ResumingAFailedJobRestoresAllAttempts) {
  Trainer("kill -9 $$");
  Start();
  const std::string name = Train().name();
  EXPECT_EQ(WaitForEnd(name).state(), v1::JOB_STATE_FAILED);
  Trainer("mkdir \"$output\"");
  const auto resumed = supervisor_->Resume(name);
  ASSERT_TRUE(resumed.ok());
  EXPECT_FALSE(resumed->has_error());
  EXPECT_EQ(WaitForEnd(name).state(), v1::JOB_STATE_SUCCEEDED);
}

TEST_F(ResumptionTest, DoesNotResumeAJobWhoseDatasetIsGone) {
  Trainer("exit 65");
  Start();
  const std::string name = Train().name();
  WaitForEnd(name);
  ASSERT_TRUE(supervisor_->DeleteDataset("town").ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(supervisor_->Resume(name).status()));
  EXPECT_EQ(store_->Get(name)->state(), v1::JOB_STATE_FAILED);
}

TEST_F(ResumptionTest, ResumingAfterATimeoutGrantsTheFullTimeAgain) {
  Trainer(kRunsOn);
  SupervisorOptions options = Options();
  options.limits.run_time = std::chrono::milliseconds(60);
  StartWith(options);
  const std::string name = Train().name();
  const v1::Job job = WaitForEnd(name);
  EXPECT_EQ(job.state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(ReasonOf(job), "WALL_TIME_EXCEEDED");
  Trainer("mkdir \"$output\"");
  supervisor_.reset();
  options.limits.run_time = std::chrono::minutes(10);
  StartWith(options);
  ASSERT_TRUE(supervisor_->Resume(name).ok());
  EXPECT_EQ(WaitForEnd(name).state(), v1::JOB_STATE_SUCCEEDED);
}

TEST_F(ResumptionTest, AllProcessesOfAJobShareItsTime) {
  // It ran for an hour when its server died.
  v1::JobProgress progress;
  progress.set_sequence(1);
  progress.mutable_time()->set_seconds(1'000 + 3'600);
  LeaveRunning("old", {}, progress);
  SupervisorOptions options = Options();
  options.limits.run_time = std::chrono::minutes(59);
  StartWith(options);
  const v1::Job job = WaitForEnd("jobs/old");
  EXPECT_EQ(ReasonOf(job), "WALL_TIME_EXCEEDED");
  EXPECT_GE(job.attempts().earlier_run_time().seconds(), 3'600);
}

TEST_F(ResumptionTest, TheTrainerIsToldOfCheckpointsThreadsActionsAndMemory) {
  Trainer("mkdir \"$output\"; echo \"$arguments\" > \"$output/arguments\"");
  SupervisorOptions options = Options();
  options.checkpoints = {.interval = std::chrono::milliseconds(1'500), .steps = 70, .kept = 4};
  options.limits.threads = 3;
  options.limits.data_memory = 5'000'000'000;
  options.least_effective_actions = 2;
  StartWith(options);
  const v1::Job job = WaitForEnd(Train().name());
  EXPECT_THAT(*files::ReadFile(folder_ / "town1" / "arguments"),
              testing::AllOf(HasSubstr("--checkpoints " + (FolderOf(job) / "checkpoints").string()),
                             HasSubstr("--checkpoint-interval 1.5 --checkpoint-steps 70 "
                                       "--checkpoints-kept 4 --least-actions 2 "
                                       "--data-memory 5000000000 "),
                             HasSubstr("--threads 3")));
}

TEST_F(ResumptionTest, HandsTheTrainerTheSettingsOfItsAdmission) {
  Trainer(kRunsOn);
  Start();
  const std::string running = Train().name();
  WaitForProgress(running);
  const std::string waiting = Train().name();
  const fs::path settings = folder_ / waiting / "settings.json";
  EXPECT_NE(files::ReadFile(settings).value_or("").find("jointEpochs"), std::string::npos);
  // As an earlier release admitted it, with another preset.
  ASSERT_TRUE(files::WriteFileAtomically(settings, "{\"seed\": \"77\"}").ok());
  Trainer("mkdir \"$output\"; cp \"$settings\" \"$output/settings\"");
  ASSERT_TRUE(supervisor_->Cancel(running).ok());
  EXPECT_EQ(WaitForEnd(waiting).state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(files::ReadFile(folder_ / "town1" / "settings").value_or(""), "{\"seed\": \"77\"}");
}

}  // namespace
}  // namespace maneuver::jobs::resumption_test
