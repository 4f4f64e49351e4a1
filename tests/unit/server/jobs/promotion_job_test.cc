// Promotion as part of a job, with a real process that measures.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "model/files/durable_file.h"
#include "server/jobs/job_attempt.h"
#include "tests/unit/server/jobs/supervisor_fixture.h"

namespace maneuver::jobs::promotion_job_test {
namespace {

using testing::HasSubstr;

constexpr char kServing[] = "models/town/versions/9";

// Trains, and reports the fraction $trained if it is set; measures version N as $nll_N nats. What it
// measured goes to `measured`.
std::string Measures(const std::string& first) {
  return first +
         "\nif [ $command = train ]; then mkdir \"$output\"; echo \"$arguments\" > "
         "\"$output/arguments\"\n"
         "[ -z \"$trained\" ] || echo \"{\\\"phase\\\":\\\"load\\\",\\\"fraction\\\":$trained}\"; "
         "exit 0; fi\n"
         "echo '{\"phase\":\"evaluate\",\"fraction\":0.5}'\n"
         "echo ${model##*/} >> \"${0%/*}/measured\"\n"
         "case ${model##*/} in 9) nll=2.0;; *) nll=$new_nll;; esac\n"
         "echo \"{\\\"examples\\\":\\\"5\\\",\\\"exampleSettings\\\":$(cat $settings),"
         "\\\"metrics\\\":{\\\"min_ade_6\\\":1,\\\"nll\\\":$nll}}\" > \"$output\"";
}

class PromotionJobTest : public SupervisorTest {
 protected:
  PromotionJobTest() { versions_.serving = security::ModelVersionName{"town", 9}; }

  static v1::TrainRequest IfNoWorse() {
    v1::TrainRequest request = TrainTown();
    request.set_promotion(v1::PROMOTION_IF_NO_WORSE);
    request.mutable_promotion_criteria()->set_dataset("datasets/village");
    return request;
  }
  // As a server leaves it that was killed after it had published version 1.
  void LeavePublished() {
    v1::Job job;
    job.set_name("jobs/left");
    job.set_state(v1::JOB_STATE_PENDING);
    *job.mutable_train() = IfNoWorse();
    LeaveRunning(job,
                 [this](v1::Job& begun) { BeginAttempt(begun, FolderOf(begun), absl::Now()); });
    versions_.published["jobs/left"] = {"town", 1};
  }
  std::string MeasuredVersions() { return files::ReadFile(folder_ / "measured").value_or(""); }
  std::string Serves() {
    const auto serving = versions_.Serving("town");
    return serving ? serving->ToString() : "";
  }
};

TEST_F(PromotionJobTest, PromotesABetterVersionAndRecordsWhy) {
  Trainer(Measures("new_nll=1.5; trained=0.8"));
  Start();
  const v1::Job job = WaitForEnd(Train(IfNoWorse()).name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(job.model_version(), "models/town/versions/1");
  EXPECT_TRUE(job.promotion_decision().promoted()) << job.DebugString();
  EXPECT_TRUE(job.promotion_decision().has_decide_time());
  EXPECT_EQ(job.promotion_decision().comparison().baseline(), kServing);
  EXPECT_EQ(job.promotion_decision().comparison().metrics(1).candidate_value(), 1.5);
  EXPECT_EQ(job.promotion_decision().comparison().metrics(1).baseline_value(), 2.0);
  EXPECT_EQ(Serves(), "models/town/versions/1");
  EXPECT_EQ(MeasuredVersions(), "1\n9\n");
  // The publication itself promoted nothing.
  EXPECT_EQ(versions_.promotions, std::vector{v1::PROMOTION_IF_NO_WORSE});
  // The trainer reported four fifths, of 0.99. The last event came half way through the second of
  // two measurements, which share the rest.
  const auto steps = store_->ListProgress(job.name(), 0, 100);
  ASSERT_TRUE(steps.ok() && !steps->empty()) << steps.status();
  EXPECT_DOUBLE_EQ(steps->back().fraction(), 1.0 - 0.25 * (1.0 - 0.99 * 0.8));
  EXPECT_EQ(job.progress().fraction(), 1.0);
}

TEST_F(PromotionJobTest, TheTrainerIsToldOfTheMeasurementsThatFollow) {
  Trainer(Measures("new_nll=1.5"));
  Start();
  const v1::Job job = WaitForEnd(Train(IfNoWorse()).name());
  const std::filesystem::path settings = FolderOf(job) / "promotion" / "settings.json";
  EXPECT_THAT(*files::ReadFile(folder_ / "town1" / "arguments"),
              testing::AllOf(
                  HasSubstr("--next-model "), HasSubstr("/9 --next-dataset "),
                  HasSubstr("village --next-settings " + settings.string() + " --next-count 2")));
}

TEST_F(PromotionJobTest, TheTrainerIsToldOfNoMeasurementIfNoneFollows) {
  versions_.serving.reset();
  Trainer(Measures("new_nll=1.5"));
  Start();
  WaitForEnd(Train(IfNoWorse()).name());
  EXPECT_THAT(*files::ReadFile(folder_ / "town1" / "arguments"),
              testing::Not(HasSubstr("--next-")));
}

TEST_F(PromotionJobTest, KeepsAWorseVersionWithoutPromotingIt) {
  Trainer(Measures("new_nll=2.5"));
  Start();
  const v1::Job job = WaitForEnd(Train(IfNoWorse()).name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(job.model_version(), "models/town/versions/1");
  EXPECT_FALSE(job.promotion_decision().promoted());
  EXPECT_THAT(job.promotion_decision().reason(), HasSubstr("nll 2.5000 against 2.0000"));
  EXPECT_EQ(Serves(), kServing);
}

TEST_F(PromotionJobTest, AFailedMeasurementDoesNotFailTheTraining) {
  Trainer(Measures("[ $command = train ] || { echo no vehicle at all >&2; exit 65; }"));
  Start();
  const v1::Job job = WaitForEnd(Train(IfNoWorse()).name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(job.model_version(), "models/town/versions/1");
  EXPECT_FALSE(job.has_error());
  EXPECT_FALSE(job.promotion_decision().promoted());
  EXPECT_THAT(job.promotion_decision().reason(), HasSubstr("no vehicle at all"));
  EXPECT_TRUE(job.promotion_decision().has_error());
  EXPECT_EQ(Serves(), kServing);
}

TEST_F(PromotionJobTest, AMeasurementThatKeepsDyingEndsTheJobUnpromoted) {
  Trainer(Measures("[ $command = train ] || { echo x >> \"${0%/*}/deaths\"; kill -9 $$; }"));
  SupervisorOptions options = Options();
  options.limits.attempts_without_progress = 3;
  StartWith(options);
  const v1::Job job = WaitForEnd(Train(IfNoWorse()).name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_FALSE(job.promotion_decision().promoted());
  EXPECT_THAT(job.promotion_decision().reason(), HasSubstr("3 processes"));
  EXPECT_EQ(*files::ReadFile(folder_ / "deaths"), "x\nx\nx\n");
  // Trained and published once.
  EXPECT_EQ(versions_.promotions.size(), 1u);
}

TEST_F(PromotionJobTest, RetriesAMeasurementThatDied) {
  Trainer(
      Measures("new_nll=1.5; [ $command = train ] || [ -e \"${0%/*}/died\" ] || "
               "{ touch \"${0%/*}/died\"; kill -9 $$; }"));
  Start();
  const v1::Job job = WaitForEnd(Train(IfNoWorse()).name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_TRUE(job.promotion_decision().promoted()) << job.DebugString();
  EXPECT_EQ(job.attempts().started(), 2);
  EXPECT_EQ(versions_.promotions.size(), 1u);
}

TEST_F(PromotionJobTest, MeasuresAgainAfterTheStoreWasAway) {
  versions_.store_away = 1;
  Trainer(Measures("new_nll=1.5"));
  Start();
  const v1::Job job = WaitForEnd(Train(IfNoWorse()).name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_TRUE(job.promotion_decision().promoted()) << job.DebugString();
  EXPECT_EQ(MeasuredVersions(), "1\n1\n9\n");
  EXPECT_EQ(Serves(), "models/town/versions/1");
}

TEST_F(PromotionJobTest, ContinuesAtTheSameStepAfterTheServerWasKilled) {
  LeavePublished();
  Trainer(Measures("[ $command = evaluate ] || exit 70; new_nll=1.5"));
  Start();
  const v1::Job job = WaitForEnd("jobs/left");
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_TRUE(job.promotion_decision().promoted()) << job.DebugString();
  EXPECT_EQ(MeasuredVersions(), "1\n9\n");
  EXPECT_EQ(versions_.promotions.size(), 0u);
  EXPECT_EQ(Serves(), "models/town/versions/1");
}

TEST_F(PromotionJobTest, ContinuesAnInterruptedMeasurementAtTheNextStart) {
  Trainer(Measures(std::string("if [ $command = evaluate ]; then ") + kRunsOn + "; fi"));
  Start();
  const std::string name = Train(IfNoWorse()).name();
  WaitForProgress(name);
  supervisor_->Stop();
  EXPECT_EQ(store_->Get(name)->state(), v1::JOB_STATE_PENDING);
  supervisor_.reset();
  Trainer(Measures("[ $command = evaluate ] || exit 70; new_nll=2.5"));
  Start();
  const v1::Job job = WaitForEnd(name);
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_FALSE(job.promotion_decision().promoted());
  EXPECT_EQ(job.promotion_decision().comparison().metrics_size(), 2) << job.DebugString();
  EXPECT_EQ(Serves(), kServing);
}

TEST_F(PromotionJobTest, AJobCancelledWhileMeasuringKeepsItsVersionUnpromoted) {
  Trainer(Measures(std::string("if [ $command = evaluate ]; then ") + kRunsOn + "; fi"));
  Start();
  const std::string name = Train(IfNoWorse()).name();
  WaitForProgress(name);
  ASSERT_TRUE(supervisor_->Cancel(name).ok());
  const v1::Job job = WaitForEnd(name);
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(job.model_version(), "models/town/versions/1");
  EXPECT_FALSE(job.promotion_decision().promoted());
  EXPECT_THAT(job.promotion_decision().reason(), HasSubstr("cancelled"));
  EXPECT_EQ(Serves(), kServing);
}

TEST_F(PromotionJobTest, EveryTrainingJobRecordsItsPromotionDecision) {
  Start();
  const auto decision = [this](v1::Promotion promotion) {
    v1::TrainRequest request = TrainTown();
    request.set_promotion(promotion);
    return WaitForEnd(Train(request).name()).promotion_decision();
  };
  EXPECT_FALSE(decision(v1::PROMOTION_NEVER).promoted());
  EXPECT_TRUE(decision(v1::PROMOTION_ALWAYS).promoted());
  const v1::PromotionDecision later = decision(v1::PROMOTION_UNSPECIFIED);
  EXPECT_FALSE(later.promoted());
  EXPECT_EQ(later.reason(), "models/town/versions/9 serves");
}

TEST_F(PromotionJobTest, RequiresTheDatasetOfTheCriteria) {
  Trainer(kRunsOn);
  Start();
  const std::string name = Train(IfNoWorse()).name();
  EXPECT_TRUE(absl::IsFailedPrecondition(supervisor_->DeleteDataset("village")));
  ASSERT_TRUE(supervisor_->Cancel(name).ok());
  WaitForEnd(name);
  EXPECT_TRUE(supervisor_->DeleteDataset("village").ok());
}

}  // namespace
}  // namespace maneuver::jobs::promotion_job_test
