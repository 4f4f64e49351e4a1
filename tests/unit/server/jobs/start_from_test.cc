// Jobs that learn from a version: which one, what their requests may ask, what the trainer is told.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "server/jobs/retention.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/server/jobs/supervisor_fixture.h"

namespace maneuver::jobs::start_from_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

std::string TextOf(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

// models/town means version 7, which is there.
class StartFromTest : public SupervisorTest {
 protected:
  StartFromTest() {
    artifact::StoredModel model = artifact::TinyModel();
    model.manifest.mutable_spec()->set_objective(v1::OBJECTIVE_UNIFIED);
    fs::create_directories(folder_ / "model");
    EXPECT_TRUE(artifact::WriteModelFolder(folder_ / "model" / "7", std::move(model)).ok());
    Trainer("echo \"$arguments\" > '" + (folder_ / "arguments").string() + "'; cp \"$settings\" '" +
            (folder_ / "settings").string() + "'; mkdir \"$output\"");
  }

  static v1::TrainRequest Request() {
    v1::TrainRequest request = TrainTown();
    request.set_start_from("models/town");
    // Of 16 x 20 pixels.
    request.mutable_settings()->mutable_augmentation()->set_shift_pixels(0);
    return request;
  }

  static std::string WrongFields(const absl::Status& status) {
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
    const auto details = status.GetPayload("type.googleapis.com/google.rpc.BadRequest");
    return details ? std::string(*details) : "";
  }
};

TEST_F(StartFromTest, TheTrainerStartsFromTheResolvedVersionWithItsSizes) {
  Start();
  const v1::Job created = Train(Request());
  EXPECT_EQ(created.train().start_from(), "models/town/versions/7");
  const v1::Job job = WaitForEnd(created.name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_THAT(TextOf(folder_ / "arguments"),
              HasSubstr("--start-from " + (folder_ / "model" / "7").string() +
                        " --start-from-name models/town/versions/7"));
  const std::string settings = TextOf(folder_ / "settings");
  EXPECT_THAT(settings, HasSubstr("\"actions\": 3"));
  EXPECT_THAT(settings, HasSubstr("\"latentDimensions\": 2"));
}

TEST_F(StartFromTest, NamesFieldsThatContradictTheStart) {
  Start();
  v1::TrainRequest request = Request();
  request.mutable_settings()->mutable_model()->set_actions(25);
  request.mutable_settings()->mutable_optimization()->set_learning_rate(-1.0);
  const std::string wrong = WrongFields(supervisor_->Train(request).status());
  EXPECT_THAT(wrong, HasSubstr("settings.model"));
  EXPECT_THAT(wrong, HasSubstr("settings.optimization.learning_rate"));

  request = Request();
  request.set_start_from("models/../town");
  EXPECT_THAT(WrongFields(supervisor_->Train(request).status()), HasSubstr("start_from"));
  request.set_start_from("models/none");
  EXPECT_TRUE(absl::IsNotFound(supervisor_->Train(request).status()));
}

TEST_F(StartFromTest, RefusesDatasetWeightsOfWrongNumberOrOutsideTraining) {
  Start();
  v1::TrainRequest request = Request();
  request.mutable_settings()->mutable_examples()->add_dataset_weights(2.0);
  request.mutable_settings()->mutable_examples()->add_dataset_weights(1.0);
  EXPECT_THAT(WrongFields(supervisor_->Train(request).status()),
              HasSubstr("settings.examples.dataset_weights"));
  request.add_datasets("datasets/village");
  EXPECT_TRUE(supervisor_->Train(request).ok());
  v1::EvaluateRequest evaluate;
  evaluate.set_dataset("datasets/town");
  evaluate.mutable_examples()->add_dataset_weights(1.0);
  EXPECT_THAT(WrongFields(supervisor_->Evaluate(evaluate).status()),
              HasSubstr("examples.dataset_weights"));
}

TEST_F(StartFromTest, TheSameRequestReturnsTheSameJobAfterTheAliasMoved) {
  Start();
  v1::TrainRequest request = Request();
  request.set_request_id("once");
  const v1::Job first = Train(request);
  supervisor_.reset();
  versions_.resolve_error = absl::NotFoundError("deleted");
  Start();
  EXPECT_EQ(Train(request).name(), first.name());
}

TEST_F(StartFromTest, FailsWithAReasonIfTheStartWasDeletedMeanwhile) {
  Start();
  Trainer(kRunsOn);
  const v1::Job running = Train();
  WaitForProgress(running.name());
  const v1::Job waiting = Train(Request());
  // The policy keeps it ...
  versions_.listed = {{{"town", 9}, false}, {{"town", 8}, false}, {{"town", 7}, false}};
  Retention retention({.versions = 1}, *supervisor_, versions_);
  ASSERT_TRUE(retention.Sweep(absl::Now()).ok());
  EXPECT_THAT(versions_.deleted, ElementsAre("models/town/versions/8"));
  // ... and a person does not.
  fs::remove_all(folder_ / "model" / "7");
  ASSERT_TRUE(supervisor_->Cancel(running.name()).ok());
  const v1::Job job = WaitForEnd(waiting.name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(ReasonOf(job), "MODEL_UNAVAILABLE");
}

}  // namespace
}  // namespace maneuver::jobs::start_from_test
