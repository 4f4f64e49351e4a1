// Cross-validation as a job, with a real process as the trainer.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "model/files/durable_file.h"
#include "server/jobs/job_requests.h"
#include "tests/unit/server/jobs/supervisor_fixture.h"

namespace maneuver::jobs::cross_validation_job_test {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

v1::CrossValidateRequest Request() {
  v1::CrossValidateRequest request;
  request.add_datasets("datasets/town");
  request.add_test_datasets("datasets/village");
  request.add_seeds(3);
  request.add_seeds(7);
  request.set_folds(4);
  return request;
}

// Leaves a report of 4 folds.
constexpr char kReports[] =
    "echo \"$arguments\" > \"${0%/*}/arguments\"\n"
    "mkdir -p \"${output%/*}\"; echo '{\"folds\": 4}' > \"$output\"";

class CrossValidationJobTest : public SupervisorTest {
 protected:
  v1::Job CrossValidate(const v1::CrossValidateRequest& request) {
    const auto job = supervisor_->CrossValidate(request);
    EXPECT_TRUE(job.ok()) << job.status();
    return job.ok() ? *job : v1::Job();
  }
  std::string Text(const std::string& file) { return files::ReadFile(folder_ / file).value_or(""); }
};

TEST_F(CrossValidationJobTest, StoresItsReportInTheJobAndPublishesNothing) {
  Trainer(kReports);
  Start();
  const v1::Job job = WaitForEnd(CrossValidate(Request()).name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(job.cross_validation().folds(), 4);
  EXPECT_EQ(job.model_version(), "");
  EXPECT_FALSE(job.has_promotion_decision());
  EXPECT_THAT(versions_.promotions, IsEmpty());
  const std::string arguments = Text("arguments");
  EXPECT_THAT(arguments, HasSubstr("cross-validate --settings"));
  EXPECT_THAT(arguments, HasSubstr("--folds 4 --fold-seed 1 --seeds 3,7 --dataset "));
  EXPECT_THAT(arguments, HasSubstr("--dataset-name town "));
  EXPECT_THAT(arguments, HasSubstr("--test-dataset village=/"));
  EXPECT_FALSE(std::filesystem::exists(FolderOf(job) / "output"));
}

TEST_F(CrossValidationJobTest, UnsetMeansFiveFoldsAndTheSeedOfTheSettings) {
  Trainer(kReports);
  Start();
  v1::CrossValidateRequest request;
  request.add_datasets("datasets/town");
  WaitForEnd(CrossValidate(request).name());
  EXPECT_THAT(Text("arguments"), HasSubstr("--folds 5 --fold-seed 1"));
  EXPECT_THAT(Text("arguments"), Not(HasSubstr("--seeds")));
}

// Dies after each model that it measured.
TEST_F(CrossValidationJobTest, ContinuesAfterTheModelsAlreadyMeasured) {
  Trainer(std::string("mkdir -p \"$checkpoints\"; n=$(ls \"$checkpoints\" | wc -l)\n"
                      "echo $n >> \"${0%/*}/found\"\n"
                      "[ $n -ge 7 ] || { touch \"$checkpoints/checkpoint-$((n + 1))\"; kill -9 $$; "
                      "}\n") +
          kReports);
  Start();
  const v1::Job job = WaitForEnd(CrossValidate(Request()).name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(job.attempts().started(), 8);
  EXPECT_EQ(Text("found"), "0\n1\n2\n3\n4\n5\n6\n7\n");
  EXPECT_FALSE(std::filesystem::exists(FolderOf(job) / "checkpoints"));
}

TEST_F(CrossValidationJobTest, CanBeCancelledAndResumed) {
  Trainer(kRunsOn);
  Start();
  const std::string name = CrossValidate(Request()).name();
  WaitForProgress(name);
  ASSERT_TRUE(supervisor_->Cancel(name).ok());
  EXPECT_EQ(WaitForEnd(name).state(), v1::JOB_STATE_CANCELLED);
  Trainer(kReports);
  ASSERT_TRUE(supervisor_->Resume(name).ok());
  EXPECT_EQ(WaitFor(name, [](const v1::Job& job) { return job.state() == v1::JOB_STATE_SUCCEEDED; })
                .cross_validation()
                .folds(),
            4);
}

TEST_F(CrossValidationJobTest, FailsWithoutAReport) {
  Trainer("exit 0");
  Start();
  const v1::Job job = WaitForEnd(CrossValidate(Request()).name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(ReasonOf(job), "TRAINER_INTERNAL");
}

TEST_F(CrossValidationJobTest, NeedsItsDatasetsAndTestDatasets) {
  Trainer(kRunsOn);
  Start();
  const std::string name = CrossValidate(Request()).name();
  EXPECT_TRUE(absl::IsFailedPrecondition(supervisor_->DeleteDataset("town")));
  EXPECT_TRUE(absl::IsFailedPrecondition(supervisor_->DeleteDataset("village")));
  ASSERT_TRUE(supervisor_->Cancel(name).ok());
  WaitForEnd(name);
  v1::CrossValidateRequest request = Request();
  request.set_test_datasets(0, "datasets/nowhere");
  EXPECT_TRUE(absl::IsNotFound(supervisor_->CrossValidate(request).status()));
}

TEST_F(CrossValidationJobTest, TheSameRequestIdReturnsTheSameJob) {
  Trainer(kReports);
  Start();
  v1::CrossValidateRequest request = Request();
  request.set_request_id("once");
  const std::string name = CrossValidate(request).name();
  EXPECT_EQ(CrossValidate(request).name(), name);
  request.set_folds(3);
  EXPECT_TRUE(absl::IsAlreadyExists(supervisor_->CrossValidate(request).status()));
  request.set_request_id("other");
  request.set_validate_only(true);
  EXPECT_EQ(CrossValidate(request).name(), "");
}

TEST(CrossValidateRequestTest, RefusesInvalidRequests) {
  EXPECT_TRUE(CheckCrossValidateRequest(Request()).ok());
  const auto refuses = [](const std::string& field, auto change) {
    v1::CrossValidateRequest request = Request();
    change(request);
    const absl::Status status = CheckCrossValidateRequest(request);
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << field;
    EXPECT_THAT(std::string(status.message()), HasSubstr(field));
  };
  using Request = v1::CrossValidateRequest;
  refuses("datasets", [](Request& r) { r.clear_datasets(); });
  refuses("datasets[0]", [](Request& r) { r.set_datasets(0, "town"); });
  refuses("datasets[1]", [](Request& r) { r.add_datasets("datasets/town"); });
  refuses("test_datasets[0]", [](Request& r) { r.set_test_datasets(0, "datasets/town"); });
  refuses("folds", [](Request& r) { r.set_folds(1); });
  refuses("folds", [](Request& r) { r.set_folds(101); });
  refuses("fold_seed", [](Request& r) { r.set_fold_seed(-1); });
  refuses("seeds[1]", [](Request& r) { r.set_seeds(1, 3); });
  refuses("seeds[0]", [](Request& r) { r.set_seeds(0, -3); });
  refuses("priority", [](Request& r) { r.set_priority(101); });
  refuses("settings.", [](Request& r) { r.mutable_settings()->set_preset("none"); });
  refuses("dataset_weights", [](Request& r) {
    r.mutable_settings()->mutable_examples()->mutable_dataset_weights()->Add(1.0);
    r.mutable_settings()->mutable_examples()->mutable_dataset_weights()->Add(1.0);
  });
}

}  // namespace
}  // namespace maneuver::jobs::cross_validation_job_test
