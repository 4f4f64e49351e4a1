#include "server/jobs/supervisor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>

#include "model/artifact/training_presets.h"
#include "model/files/durable_file.h"
#include "server/errors/error_details.h"
#include "tests/unit/server/jobs/supervisor_fixture.h"

namespace maneuver::jobs::supervisor_test {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

TEST_F(SupervisorTest, PublishesATrainedModelAndTheJobSucceeds) {
  Trainer(R"(echo '{"phase":"load","fraction":0.1}'
             mkdir "$output"; cp "$settings" "$output/settings"
             echo "$arguments" > "$output/arguments")");
  Start();
  v1::TrainRequest request = TrainTown();
  request.set_promotion(v1::PROMOTION_ALWAYS);
  request.mutable_settings()->set_seed(42);
  const v1::Job created = Train(request);
  EXPECT_EQ(created.state(), v1::JOB_STATE_PENDING);
  EXPECT_TRUE(created.has_create_time());

  const v1::Job job = WaitForEnd(created.name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(job.model_version(), "models/town/versions/1");
  EXPECT_EQ(job.progress().fraction(), 1.0);  // it has ended
  EXPECT_TRUE(job.has_start_time() && job.has_end_time() && !job.has_error());
  EXPECT_EQ(versions_.promotions, std::vector{v1::PROMOTION_ALWAYS});
  // What it was told: complete settings, the dataset's folder and name.
  const std::string settings = *files::ReadFile(folder_ / "town1" / "settings");
  EXPECT_THAT(settings, AllOf(HasSubstr("\"42\""), HasSubstr("jointEpochs")));
  EXPECT_THAT(*files::ReadFile(folder_ / "town1" / "arguments"),
              AllOf(HasSubstr("train "),
                    HasSubstr("--dataset " + datasets_->FolderOf("town").string() + " "),
                    HasSubstr("--dataset-name datasets/town")));
  EXPECT_FALSE(fs::exists(FolderOf(job) / "output"));
}

TEST_F(SupervisorTest, AnEvaluationStoresItsReportInTheJob) {
  Trainer(R"([ "$command" = evaluate ] || exit 64
             case "$arguments" in *"--sampled-examples 3 --data-memory 2147483648 "*) ;; *) exit 64;; esac
             printf '{"examples":"12","metrics":{"minADE6":1.5}}' > "$output")");
  Start();
  v1::EvaluateRequest request;
  request.set_model("models/town");
  request.set_dataset("datasets/village");
  request.set_sampled_examples(3);
  const auto created = supervisor_->Evaluate(request);
  ASSERT_TRUE(created.ok()) << created.status();
  // The version that it meant when it was asked for.
  EXPECT_EQ(created->evaluate().model(), "models/town/versions/7");
  const v1::Job job = WaitForEnd(created->name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(job.evaluation().model_version(), "models/town/versions/7");
  EXPECT_EQ(job.evaluation().dataset(), "datasets/village");
  EXPECT_EQ(job.evaluation().examples(), 12);
  EXPECT_EQ(job.evaluation().metrics().at("minADE6"), 1.5);
}

TEST_F(SupervisorTest, KeepsTheReportWithTheVersionAndItsDatasets) {
  Trainer("printf '{\"examples\":\"12\"}' > \"$output\"");
  Start();
  v1::EvaluateRequest request;
  request.set_model("models/town");
  request.set_dataset("datasets/village");
  const v1::Job job = WaitForEnd(supervisor_->Evaluate(request)->name());
  const std::lock_guard lock(versions_.mutex);
  const v1::EvaluationReport& kept = versions_.reports.at("models/town/versions/7");
  EXPECT_EQ(kept.SerializeAsString(), job.evaluation().SerializeAsString());
  EXPECT_EQ(kept.dataset(), "datasets/village");
  EXPECT_EQ(kept.dataset_sha256(), data::ContentSha256(*datasets_->Get("village")));
  EXPECT_TRUE(kept.has_create_time());
}

TEST_F(SupervisorTest, AnEvaluationFailsOnAFullDiskButNotForADeletedVersion) {
  Trainer("printf '{\"examples\":\"12\"}' > \"$output\"");
  Start();
  v1::EvaluateRequest request;
  request.set_model("models/town");
  request.set_dataset("datasets/village");
  versions_.keep_error = absl::ResourceExhaustedError("no space left");
  EXPECT_EQ(ReasonOf(WaitForEnd(supervisor_->Evaluate(request)->name())), "DISK_FULL");
  {
    const std::lock_guard lock(versions_.mutex);
    versions_.keep_error = absl::NotFoundError("deleted");
  }
  const v1::Job job = WaitForEnd(supervisor_->Evaluate(request)->name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(job.evaluation().examples(), 12);
}

TEST_F(SupervisorTest, AFailureHasAReasonAndTheLastLogLineWithoutPaths) {
  Trainer("echo first >&2; echo \"no vehicle in $dataset/x.tfrecord\" >&2; exit 65");
  Start();
  const v1::Job job = WaitForEnd(Train().name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(ReasonOf(job), "UNUSABLE_DATA");
  EXPECT_THAT(job.error().message(), HasSubstr("no vehicle in x.tfrecord"));
  EXPECT_THAT(job.error().message(), Not(HasSubstr("datasets")));
  EXPECT_THAT(job.last_lines(), ElementsAre("first", "no vehicle in x.tfrecord"));
}

TEST_F(SupervisorTest, FailsIfTheTrainerCannotBeStarted) {
  SupervisorOptions options = Options();
  options.trainer = folder_ / "no-such-program";
  StartWith(options);
  const v1::Job job = WaitForEnd(Train().name());
  EXPECT_EQ(ReasonOf(job), "TRAINER_INTERNAL");
  EXPECT_THAT(job.error().message(), HasSubstr("cannot be started"));
}

TEST_F(SupervisorTest, AFailedPublicationFailsTheJobAndLeavesNothing) {
  versions_.publish_error = absl::DataLossError("tensor decoder.0.weight is missing in /data/x");
  Start();
  const v1::Job job = WaitForEnd(Train().name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(ReasonOf(job), "MODEL_REFUSED");
  EXPECT_THAT(job.error().message(), HasSubstr("decoder.0.weight is missing in x"));
  EXPECT_FALSE(fs::exists(FolderOf(job) / "output"));
}

TEST_F(SupervisorTest, AnEvaluationWithoutAReportFails) {
  Trainer("exit 0");
  Start();
  v1::EvaluateRequest request;
  request.set_model("models/town");
  request.set_dataset("datasets/town");
  EXPECT_EQ(ReasonOf(WaitForEnd(supervisor_->Evaluate(request)->name())), "TRAINER_INTERNAL");
}

TEST_F(SupervisorTest, ARequestIdCreatesOnlyOneJob) {
  Start();
  v1::TrainRequest request = TrainTown();
  request.set_request_id("mine");
  const v1::Job first = Train(request);
  WaitForEnd(first.name());
  const v1::Job again = Train(request);
  EXPECT_EQ(again.name(), first.name());
  EXPECT_EQ(again.state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(store_->List(10, "")->jobs.size(), 1u);

  request.mutable_settings()->set_seed(2);
  const auto other = supervisor_->Train(request);
  EXPECT_TRUE(absl::IsAlreadyExists(other.status())) << other.status();
  EXPECT_THAT(std::string(other.status().message()), HasSubstr(first.name()));
}

TEST_F(SupervisorTest, ValidateOnlyStartsNothing) {
  Start();
  v1::TrainRequest request = TrainTown();
  request.set_validate_only(true);
  const v1::Job checked = Train(request);
  EXPECT_EQ(checked.name(), "");
  // It shows what a job would learn with.
  EXPECT_EQ(checked.train().settings().DebugString(),
            artifact::ResolveTrainingSettings(request.settings()).DebugString());
  EXPECT_GT(checked.train().settings().optimization().joint_epochs(), 0);
  EXPECT_GT(checked.train().settings().model().actions(), 0);
  EXPECT_GT(checked.memory().recording_bytes(), 0);
  EXPECT_GT(checked.memory().total_bytes(), checked.memory().data_bytes());
  EXPECT_THAT(store_->List(10, "")->jobs, IsEmpty());
  request.set_datasets(0, "datasets/none");
  EXPECT_TRUE(absl::IsNotFound(supervisor_->Train(request).status()));
}

TEST_F(SupervisorTest, StartsTheRanksOfAJobByTheTrainerOrByTheLauncher) {
  // Only a job that fails keeps what its trainer said.
  Trainer("echo \"$STARTED_BY $arguments\" >&2; exit 65");
  Start();
  v1::TrainRequest request = TrainTown();
  request.set_ranks(2);
  EXPECT_THAT(WaitForEnd(Train(request).name()).last_lines(),
              ElementsAre(AllOf(HasSubstr(" train "), HasSubstr("--ranks 2"))));
  EXPECT_THAT(WaitForEnd(Train().name()).last_lines(), ElementsAre(Not(HasSubstr("--ranks"))));
  supervisor_.reset();
  SupervisorOptions options = Options();
  options.launcher = {"env", "STARTED_BY=launcher-{ranks}"};
  StartWith(options);
  EXPECT_THAT(WaitForEnd(Train(request).name()).last_lines(),
              ElementsAre(AllOf(HasSubstr("launcher-2 train "), Not(HasSubstr("--ranks")))));
  EXPECT_THAT(WaitForEnd(Train().name()).last_lines(), ElementsAre(HasSubstr("launcher-1 train ")));
}

TEST_F(SupervisorTest, RefusesRanksThatCannotShareTheMicroBatches) {
  Start();
  v1::TrainRequest request = TrainTown();
  for (const int ranks : {-1, 3, 16, 128}) {  // micro-batches are 8 if they are not set
    request.set_ranks(ranks);
    const absl::Status status = supervisor_->Train(request).status();
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << ranks;
    EXPECT_THAT(std::string(status.message()), HasSubstr("ranks"));
  }
  request.mutable_settings()->mutable_optimization()->set_micro_batches(16);
  request.set_ranks(16);
  request.set_validate_only(true);
  EXPECT_TRUE(supervisor_->Train(request).ok());
}

TEST_F(SupervisorTest, RefusesADeviceThatTheTrainerDoesNotHave) {
  // The policy of the processor's time, as proc(5) numbers the fields.
  Trainer(
      "[ $command = devices ] && echo cpu && cut -d' ' -f41 /proc/self/stat >> "
      "\"$(dirname $0)\"/asked");
  Start();
  v1::TrainRequest request = TrainTown();
  request.set_validate_only(true);
  request.mutable_settings()->set_device("cuda");
  for (int i = 0; i < 2; ++i) {
    const absl::Status refused = supervisor_->Train(request).status();
    EXPECT_TRUE(absl::IsInvalidArgument(refused)) << refused;
    EXPECT_THAT(std::string(refused.message()), HasSubstr("settings.device"));
  }
  EXPECT_EQ(*files::ReadFile(folder_ / "asked"), std::to_string(sched_getscheduler(0)) + "\n")
      << "it is asked once, and a caller who waits does not wait for all other processes";
  v1::CrossValidateRequest folds;
  *folds.add_datasets() = request.datasets(0);
  folds.mutable_settings()->set_device("cuda");
  folds.set_validate_only(true);
  EXPECT_TRUE(absl::IsInvalidArgument(supervisor_->CrossValidate(folds).status()));
  request.mutable_settings()->set_device("cpu");
  EXPECT_TRUE(supervisor_->Train(request).ok());
}

TEST_F(SupervisorTest, AcceptsADeviceThatTheTrainerHasOrDoesNotKnowOf) {
  Trainer("[ $command = devices ] && echo cpu && echo cuda");
  Start();
  v1::TrainRequest request = TrainTown();
  request.set_validate_only(true);
  request.mutable_settings()->set_device("cuda");
  EXPECT_TRUE(supervisor_->Train(request).ok());
  // An earlier release of the trainer.
  Trainer("exit 64");
  Start();
  EXPECT_TRUE(supervisor_->Train(request).ok());
}

TEST_F(SupervisorTest, NamesWrongFieldsOfRequests) {
  Start();
  v1::TrainRequest request = TrainTown();
  request.set_model("models/Town");
  request.add_datasets("datasets/../x");
  request.add_datasets("datasets/town");
  request.mutable_settings()->mutable_optimization()->set_learning_rate(-1.0);
  request.set_request_id(std::string(129, 'x'));
  const absl::Status status = supervisor_->Train(request).status();
  EXPECT_TRUE(absl::IsInvalidArgument(status));
  const std::string details(status.GetPayload("type.googleapis.com/google.rpc.BadRequest").value());
  for (const char* field : {"model", "datasets[1]", "datasets[2]", "request_id",
                            "settings.optimization.learning_rate"}) {
    EXPECT_THAT(details, HasSubstr(field));
  }
  v1::EvaluateRequest evaluate;
  evaluate.set_dataset("town");
  EXPECT_TRUE(absl::IsInvalidArgument(supervisor_->Evaluate(evaluate).status()));
  evaluate.set_dataset("datasets/town");
  for (const int samples : {-1, 1001}) {
    evaluate.set_sampled_examples(samples);
    EXPECT_TRUE(absl::IsInvalidArgument(supervisor_->Evaluate(evaluate).status())) << samples;
  }
  evaluate.set_sampled_examples(1000);
  evaluate.set_model("models/none");
  EXPECT_TRUE(absl::IsNotFound(supervisor_->Evaluate(evaluate).status()));
}

TEST_F(SupervisorTest, NamesWrongFieldsOfPromotionCriteria) {
  Start();
  v1::TrainRequest request = TrainTown();
  request.set_promotion(v1::PROMOTION_IF_NO_WORSE);
  v1::PromotionCriteria& criteria = *request.mutable_promotion_criteria();
  for (const char* metric : {"min_ade_6", "min_ade_6", "no_such", "effective_actions", "ade_cv"}) {
    criteria.add_metrics()->set_metric(metric);
  }
  criteria.mutable_metrics(0)->set_tolerance(-0.1);
  criteria.mutable_examples()->set_keep_standing(2.0);
  const absl::Status status = supervisor_->Train(request).status();
  EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
  const std::string details(status.GetPayload("type.googleapis.com/google.rpc.BadRequest").value());
  for (const char* field :
       {"promotion_criteria.dataset", "promotion_criteria.metrics[0].tolerance",
        "promotion_criteria.metrics[1].metric", "promotion_criteria.metrics[2].metric",
        "promotion_criteria.metrics[3].metric", "promotion_criteria.metrics[4].metric",
        "promotion_criteria.examples.keep_standing"}) {
    EXPECT_THAT(details, HasSubstr(field));
  }
  EXPECT_THAT(details, Not(HasSubstr("metrics[0].metric")));

  v1::TrainRequest other = TrainTown();
  other.mutable_promotion_criteria()->set_dataset("datasets/town");
  EXPECT_TRUE(absl::IsInvalidArgument(supervisor_->Train(other).status()));
  other.set_promotion(v1::PROMOTION_IF_NO_WORSE);
  other.set_validate_only(true);
  EXPECT_TRUE(supervisor_->Train(other).ok());
  // It is read as the others are, and must be there.
  other.mutable_promotion_criteria()->set_dataset("datasets/none");
  EXPECT_TRUE(absl::IsNotFound(supervisor_->Train(other).status()));
}

TEST_F(SupervisorTest, CancelsARunningJob) {
  Trainer(kRunsOn);
  Start();
  const std::string name = Train().name();
  WaitForProgress(name);
  const auto answer = supervisor_->Cancel(name);
  ASSERT_TRUE(answer.ok());
  const v1::Job job = WaitForEnd(name);
  EXPECT_EQ(job.state(), v1::JOB_STATE_CANCELLED);
  EXPECT_TRUE(job.has_end_time() && !job.has_error());
  EXPECT_THAT(versions_.promotions, IsEmpty());
}

TEST_F(SupervisorTest, KillsATrainerThatIgnoresSigterm) {
  Trainer(kIgnoresSigterm);
  SupervisorOptions options = Options();
  options.patience = std::chrono::milliseconds(50);
  StartWith(options);
  const std::string name = Train().name();
  WaitForProgress(name);
  ASSERT_TRUE(supervisor_->Cancel(name).ok());
  EXPECT_EQ(WaitForEnd(name).state(), v1::JOB_STATE_CANCELLED);
}

TEST_F(SupervisorTest, CancelsAPendingJobAtOnce) {
  Trainer(kRunsOn);
  Start();
  const std::string first = Train().name();
  WaitForProgress(first);
  const std::string second = Train().name();
  const auto cancelled = supervisor_->Cancel(second);
  ASSERT_TRUE(cancelled.ok()) << cancelled.status();
  EXPECT_EQ(cancelled->state(), v1::JOB_STATE_CANCELLED);
  EXPECT_FALSE(cancelled->has_start_time());
  ASSERT_TRUE(supervisor_->Cancel(first).ok());
  WaitForEnd(first);
  EXPECT_FALSE(fs::exists(folder_ / second / "trainer.log"));
}

TEST_F(SupervisorTest, CancellingAnEndedJobChangesNothing) {
  Start();
  const v1::Job job = WaitForEnd(Train().name());
  const auto answer = supervisor_->Cancel(job.name());
  ASSERT_TRUE(answer.ok());
  EXPECT_EQ(answer->state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_TRUE(absl::IsNotFound(supervisor_->Cancel("jobs/none").status()));
}

TEST_F(SupervisorTest, DeletesAnEndedJobWithItsFolder) {
  Trainer(kRunsOn);
  Start();
  const v1::Job job = Train();
  WaitForProgress(job.name());
  EXPECT_TRUE(absl::IsFailedPrecondition(supervisor_->Delete(job.name())));
  ASSERT_TRUE(supervisor_->Cancel(job.name()).ok());
  WaitForEnd(job.name());
  EXPECT_TRUE(fs::exists(FolderOf(job)));
  EXPECT_TRUE(supervisor_->Delete(job.name()).ok());
  EXPECT_FALSE(fs::exists(FolderOf(job)));
  EXPECT_TRUE(absl::IsNotFound(supervisor_->Get(job.name()).status()));
}

TEST_F(SupervisorTest, KeepsADatasetThatAJobNeeds) {
  Trainer(kRunsOn);
  Start();
  const std::string running = Train().name();
  WaitForProgress(running);
  v1::TrainRequest request = TrainTown();
  request.set_datasets(0, "datasets/village");
  const std::string pending = Train(request).name();
  for (const char* id : {"town", "village"}) {
    EXPECT_TRUE(absl::IsFailedPrecondition(supervisor_->DeleteDataset(id))) << id;
  }
  ASSERT_TRUE(supervisor_->Cancel(pending).ok());
  EXPECT_TRUE(supervisor_->DeleteDataset("village").ok());
  EXPECT_FALSE(datasets_->Contains("village"));
  EXPECT_TRUE(absl::IsNotFound(supervisor_->DeleteDataset("village")));
  EXPECT_TRUE(absl::IsNotFound(supervisor_->Train(request).status()));
}

TEST_F(SupervisorTest, RunsJobsInTheOrderOfCreation) {
  Trainer("echo \"$dataset_name\" >> \"${0%/*}/order\"; mkdir \"$output\"");
  Start();
  std::string last;
  for (const char* dataset : {"datasets/town", "datasets/village", "datasets/town"}) {
    v1::TrainRequest request = TrainTown();
    request.set_datasets(0, dataset);
    last = Train(request).name();
  }
  WaitForEnd(last);
  EXPECT_EQ(*files::ReadFile(folder_ / "order"),
            "datasets/town\ndatasets/village\ndatasets/town\n");
}

TEST_F(SupervisorTest, RunsAHigherPriorityFirst) {
  Trainer(
      "echo \"$dataset_name\" >> \"${0%/*}/order\"; [ -e \"${0%/*}/go\" ] || "
      "{ trap 'exit 143' TERM; echo '{\"phase\":\"load\"}'; while :; do sleep 0.02; done; }; "
      "mkdir \"$output\"");
  Start();
  const std::string first = Train().name();
  WaitForProgress(first);
  const std::string low = Train().name();
  v1::TrainRequest request = TrainTown();
  request.set_datasets(0, "datasets/village");
  request.set_priority(1);
  const std::string high = Train(request).name();
  std::ofstream(folder_ / "go") << "";
  ASSERT_TRUE(supervisor_->Cancel(first).ok());
  WaitForEnd(low);
  WaitForEnd(high);
  EXPECT_EQ(*files::ReadFile(folder_ / "order"),
            "datasets/town\ndatasets/village\ndatasets/town\n");
  request.set_priority(101);
  EXPECT_TRUE(absl::IsInvalidArgument(supervisor_->Train(request).status()));
}

TEST_F(SupervisorTest, EveryWatcherGetsTheSameEventsWheneverItSubscribes) {
  // Ends of epochs are never left out, so all of them are events.
  Trainer(R"(for i in 1 2 3 4 5 6 7 8 9 10 11 12; do
               echo "{\"phase\":\"joint\",\"epoch\":$i,\"epochReport\":{}}"
             done
             echo 'not a message'
             mkdir "$output")");
  Start();
  const std::string job = Train().name();
  std::vector<std::vector<v1::Job>> seen(3);
  std::vector<std::thread> watchers;
  for (size_t i = 0; i < seen.size(); ++i) {
    watchers.emplace_back(
        [&, i] { seen[i] = Follow(supervisor_->news(), *store_, job, 0, i == 0 ? 1 : 5); });
  }
  for (std::thread& watcher : watchers) watcher.join();
  seen.push_back(Follow(supervisor_->news(), *store_, job, 0, 100));
  for (const auto& events : seen) {
    ASSERT_EQ(events.size(), 13u);
    for (int i = 0; i < 13; ++i) {
      const v1::Job& event = events[static_cast<size_t>(i)];
      EXPECT_EQ(event.SerializeAsString(), seen[0][static_cast<size_t>(i)].SerializeAsString());
      EXPECT_EQ(event.state(), i < 12 ? v1::JOB_STATE_RUNNING : v1::JOB_STATE_SUCCEEDED);
      EXPECT_EQ(event.progress().sequence(), std::min(i + 1, 12));
      EXPECT_EQ(event.progress().epoch(), std::min(i + 1, 12));
    }
  }
  const auto rest = Follow(supervisor_->news(), *store_, job, 10, 100);
  ASSERT_EQ(rest.size(), 3u);
  EXPECT_EQ(rest[0].progress().sequence(), 11);
}

TEST_F(SupervisorTest, RefusesAJobIfTheQueueIsFull) {
  Trainer("sleep 100");
  SupervisorOptions options = Options();
  options.max_pending_jobs = 2;
  StartWith(options);
  int accepted = 0;
  absl::StatusOr<v1::Job> job = supervisor_->Train(TrainTown());
  for (; job.ok() && accepted < 10; job = supervisor_->Train(TrainTown())) ++accepted;
  // One may run by now.
  EXPECT_GE(accepted, 2);
  EXPECT_LE(accepted, 3);
  EXPECT_EQ(job.status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(errors::ReasonOf(job.status()), "TOO_MANY_JOBS");
  EXPECT_TRUE(errors::RetryDelay(job.status()).has_value());
}

}  // namespace
}  // namespace maneuver::jobs::supervisor_test
