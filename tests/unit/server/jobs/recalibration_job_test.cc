// Recalibration as a job, with a real process as the trainer.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <mutex>
#include <string>

#include "model/files/durable_file.h"
#include "server/jobs/job_requests.h"
#include "server/jobs/retention.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/server/jobs/supervisor_fixture.h"

namespace maneuver::jobs::recalibration_job_test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

v1::RecalibrateRequest Request() {
  v1::RecalibrateRequest request;
  request.set_model("models/town");
  request.add_datasets("datasets/town");
  request.mutable_examples()->set_validation_share(0.25);
  return request;
}

v1::RecalibrateRequest IfNoWorse() {
  v1::RecalibrateRequest request = Request();
  request.set_promotion(v1::PROMOTION_IF_NO_WORSE);
  request.mutable_promotion_criteria()->set_dataset("datasets/village");
  request.mutable_promotion_criteria()->add_metrics()->set_metric("nll");
  return request;
}

// Fits, and measures version 7 as 2 nats, others as $nll.
std::string Fits(const std::string& nll) {
  return "echo \"$arguments\" >> \"${0%/*}/arguments\"\n"
         "if [ $command = recalibrate ]; then mkdir \"$output\"; exit 0; fi\n"
         "case ${model##*/} in 7) nll=2.0;; *) nll=" +
         nll +
         ";; esac\n"
         "echo \"{\\\"examples\\\":\\\"5\\\",\\\"exampleSettings\\\":$(cat $settings),"
         "\\\"metrics\\\":{\\\"nll\\\":$nll}}\" > \"$output\"";
}

// models/town means version 7, which serves.
class RecalibrationJobTest : public SupervisorTest {
 protected:
  RecalibrationJobTest() {
    fs::create_directories(folder_ / "model");
    EXPECT_TRUE(artifact::WriteModelFolder(folder_ / "model" / "7", artifact::TinyModel()).ok());
    versions_.serving = security::ModelVersionName{"town", 7};
    Trainer(Fits("1.5"));
  }

  v1::Job Recalibrate(const v1::RecalibrateRequest& request = Request()) {
    const auto job = supervisor_->Recalibrate(request);
    EXPECT_TRUE(job.ok()) << job.status();
    return job.ok() ? *job : v1::Job();
  }
  std::string Arguments() { return files::ReadFile(folder_ / "arguments").value_or(""); }
  std::string Serves() { return versions_.Serving("town")->ToString(); }
};

TEST_F(RecalibrationJobTest, MakesANewVersionThatDoesNotServe) {
  Start();
  const v1::Job created = Recalibrate();
  EXPECT_EQ(created.recalibrate().model(), "models/town/versions/7");
  const v1::Job job = WaitForEnd(created.name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(job.model_version(), "models/town/versions/1");
  EXPECT_TRUE(job.has_promotion_decision());
  EXPECT_FALSE(job.promotion_decision().promoted());
  EXPECT_EQ(Serves(), "models/town/versions/7");
  EXPECT_THAT(Arguments(), HasSubstr("recalibrate --model " + (folder_ / "model" / "7").string() +
                                     " --model-name models/town/versions/7 --settings "));
  EXPECT_THAT(Arguments(), HasSubstr("/town --dataset-name datasets/town"));
  EXPECT_THAT(files::ReadFile(FolderOf(job) / "settings.json").value_or(""),
              HasSubstr("\"validationShare\": 0.25"));
}

TEST_F(RecalibrationJobTest, ABetterVersionIsPromotedByItsMeasurements) {
  Start();
  const v1::Job job = WaitForEnd(Recalibrate(IfNoWorse()).name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_TRUE(job.promotion_decision().promoted()) << job.DebugString();
  EXPECT_EQ(job.promotion_decision().comparison().baseline(), "models/town/versions/7");
  EXPECT_EQ(Serves(), "models/town/versions/1");
}

TEST_F(RecalibrationJobTest, AWorseVersionIsKeptWithoutBeingPromoted) {
  Trainer(Fits("2.5"));
  Start();
  const v1::Job job = WaitForEnd(Recalibrate(IfNoWorse()).name());
  EXPECT_EQ(job.model_version(), "models/town/versions/1");
  EXPECT_FALSE(job.promotion_decision().promoted()) << job.DebugString();
  EXPECT_EQ(Serves(), "models/town/versions/7");
}

TEST_F(RecalibrationJobTest, AProcessThatDiesIsFollowedByAnother) {
  Trainer("[ -e \"${0%/*}/died\" ] || { touch \"${0%/*}/died\"; kill -9 $$; }\n" + Fits("1.5"));
  Start();
  const v1::Job job = WaitForEnd(Recalibrate().name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(job.attempts().started(), 2);
  EXPECT_EQ(versions_.promotions.size(), 1u);
}

TEST_F(RecalibrationJobTest, NeedsItsDatasetsAndItsVersion) {
  Trainer(kRunsOn);
  Start();
  const std::string name = Recalibrate(IfNoWorse()).name();
  EXPECT_TRUE(absl::IsFailedPrecondition(supervisor_->DeleteDataset("town")));
  EXPECT_TRUE(absl::IsFailedPrecondition(supervisor_->DeleteDataset("village")));
  {
    const std::lock_guard lock(versions_.mutex);
    versions_.listed = {{{"town", 9}, false}, {{"town", 7}, false}};
  }
  Retention retention({.versions = 1}, *supervisor_, versions_);
  EXPECT_TRUE(retention.Sweep(absl::Now()).ok());
  EXPECT_TRUE(versions_.deleted.empty());
  ASSERT_TRUE(supervisor_->Cancel(name).ok());
  EXPECT_EQ(WaitForEnd(name).state(), v1::JOB_STATE_CANCELLED);
  v1::RecalibrateRequest request = Request();
  request.set_model("models/none");
  EXPECT_TRUE(absl::IsNotFound(supervisor_->Recalibrate(request).status()));
}

TEST_F(RecalibrationJobTest, TheSameRequestIdReturnsTheSameJob) {
  Start();
  v1::RecalibrateRequest request = Request();
  request.set_request_id("once");
  const std::string name = Recalibrate(request).name();
  EXPECT_EQ(Recalibrate(request).name(), name);
  request.set_priority(3);
  EXPECT_TRUE(absl::IsAlreadyExists(supervisor_->Recalibrate(request).status()));
  request.set_request_id("other");
  request.set_validate_only(true);
  const v1::Job valid = Recalibrate(request);
  EXPECT_EQ(valid.name(), "");
  EXPECT_GT(valid.memory().total_bytes(), 0);
  EXPECT_TRUE(valid.recalibrate().examples().has_stride());
}

TEST(RecalibrateRequestTest, RefusesInvalidRequests) {
  EXPECT_TRUE(CheckRecalibrateRequest(Request()).ok());
  const auto refuses = [](const std::string& field, auto change) {
    v1::RecalibrateRequest request = Request();
    change(request);
    const absl::Status status = CheckRecalibrateRequest(request);
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << field;
    EXPECT_THAT(std::string(status.message()), HasSubstr(field));
  };
  using Request = v1::RecalibrateRequest;
  refuses("model", [](Request& r) { r.set_model("town"); });
  refuses("datasets", [](Request& r) { r.clear_datasets(); });
  refuses("datasets[1]", [](Request& r) { r.add_datasets("datasets/town"); });
  refuses("priority", [](Request& r) { r.set_priority(-101); });
  refuses("request_id", [](Request& r) { r.set_request_id(std::string(200, 'a')); });
  refuses("promotion", [](Request& r) { r.set_promotion(static_cast<v1::Promotion>(17)); });
  refuses("promotion_criteria",
          [](Request& r) { r.mutable_promotion_criteria()->set_dataset("datasets/town"); });
  refuses("promotion_criteria.dataset",
          [](Request& r) { r.set_promotion(v1::PROMOTION_IF_NO_WORSE); });
  refuses("examples.validation_share",
          [](Request& r) { r.mutable_examples()->set_validation_share(1.5); });
  refuses("dataset_weights", [](Request& r) { r.mutable_examples()->add_dataset_weights(1.0); });
}

}  // namespace
}  // namespace maneuver::jobs::recalibration_job_test
