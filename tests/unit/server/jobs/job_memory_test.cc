// What a job is said to take of memory, against sums by hand.

#include "server/jobs/job_memory.h"

#include <gtest/gtest.h>

#include "model/artifact/model_cost.h"
#include "model/artifact/training_presets.h"
#include "model/data/dataset_folder.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::jobs::job_memory_test {
namespace {

class JobMemoryTest : public testing::Test {
 protected:
  JobMemoryTest() : datasets_(*data::DatasetStore::Open(folder_ / "datasets")) {
    for (const char* name : {"town", "village"}) {
      auto writer = data::DatasetWriter::Create(datasets_->FolderOf(name), "a test");
      for (int i = 0; i < 40; ++i) {
        EXPECT_TRUE((*writer)->Add(data::SmallRecording("r" + std::to_string(i))).ok());
      }
      bytes_ = (*writer)->Commit()->shards(0).size_bytes();
    }
    v1::TrainRequest& train = *training_.mutable_train();
    train.add_datasets("datasets/town");
    train.add_datasets("datasets/village");
    *train.mutable_settings() = artifact::ResolveTrainingSettings({});
  }

  v1::JobMemory Estimate(const v1::Job& job, int64_t data_memory) {
    const auto memory =
        EstimateMemory(job, training_.train().settings().model(), *datasets_, data_memory);
    EXPECT_TRUE(memory.ok()) << memory.status();
    return *memory;
  }

  const TemporaryFolder folder_;
  const std::unique_ptr<data::DatasetStore> datasets_;
  int64_t bytes_ = 0;  // of each dataset
  v1::Job training_;
};

TEST_F(JobMemoryTest, DataThatFitTakeFiveTimesTheirSize) {
  const v1::JobMemory memory = Estimate(training_, 10 * bytes_);
  EXPECT_TRUE(memory.data_fit());
  EXPECT_EQ(memory.recording_bytes(), 2 * bytes_);
  EXPECT_EQ(memory.data_bytes(), 10 * bytes_);
}

TEST_F(JobMemoryTest, DataBeyondTheLimitCountAsTheLimitPlusAnIndex) {
  const v1::JobMemory memory = Estimate(training_, 10 * bytes_ - 5);
  EXPECT_FALSE(memory.data_fit());
  EXPECT_EQ(memory.data_bytes(), 10 * bytes_ - 5 + 80 * 200);
  // Calibration then uses the fewest examples: 100 held-out ones.
  EXPECT_LT(memory.working_bytes(), Estimate(training_, 10 * bytes_).working_bytes());
}

TEST_F(JobMemoryTest, AnEvaluationHasOneCopyOfTheWeightsAndATrainingFive) {
  v1::Job evaluation;
  evaluation.mutable_evaluate()->set_dataset("datasets/town");
  const v1::JobMemory memory = Estimate(evaluation, int64_t{1} << 40);
  EXPECT_EQ(memory.recording_bytes(), bytes_);
  EXPECT_EQ(memory.network_bytes(),
            4 * artifact::CountCost(training_.train().settings().model()).parameters());
  EXPECT_EQ(Estimate(training_, int64_t{1} << 40).network_bytes(), 5 * memory.network_bytes());
}

TEST_F(JobMemoryTest, ACrossValidationAddsItsMeasurementsForEachSeed) {
  v1::Job validation;
  v1::CrossValidateRequest& request = *validation.mutable_cross_validate();
  *request.mutable_datasets() = training_.train().datasets();
  *request.mutable_settings() = training_.train().settings();
  for (int64_t seed = 1; seed <= 30; ++seed) request.add_seeds(seed);
  const int64_t data_memory = 10 * bytes_ - 5;
  const v1::JobMemory memory = Estimate(validation, data_memory);
  const v1::JobMemory of_training = Estimate(training_, data_memory);
  EXPECT_FALSE(memory.data_fit());
  EXPECT_EQ(memory.data_bytes(), of_training.data_bytes());
  EXPECT_EQ(memory.working_bytes(), of_training.working_bytes() + 3 * bytes_);
}

TEST_F(JobMemoryTest, TheTotalIsTheSumWithTheProgram) {
  const v1::JobMemory memory = Estimate(training_, int64_t{1} << 31);
  const int64_t program =
      memory.total_bytes() - memory.data_bytes() - memory.network_bytes() - memory.working_bytes();
  EXPECT_GT(program, 50'000'000);
  EXPECT_LT(program, 300'000'000);
}

TEST_F(JobMemoryTest, ADamagedDatasetIsNamed) {
  std::filesystem::resize_file(
      datasets_->FolderOf("town") / datasets_->Get("town")->shards(0).file(), 1);
  const auto memory =
      EstimateMemory(training_, training_.train().settings().model(), *datasets_, int64_t{1} << 31);
  EXPECT_TRUE(absl::IsDataLoss(memory.status())) << memory.status();
}

TEST(PredictionBytesTest, CountsTheMomentsOfAllActions) {
  // 25 actions of 50 waypoints, D = 2: a mean of 2 and a covariance of 3 numbers each, and two more
  // covariances where the scene predicts them.
  v1::ModelSpec spec;
  spec.set_actions(25);
  spec.set_latent_dimensions(2);
  spec.mutable_trajectory()->set_waypoints(50);
  EXPECT_EQ(artifact::PredictionBytes(spec), 4 * (25 * (5 * 50 + 2 + 2) + 100 + 1));
  spec.mutable_scene_covariance();
  EXPECT_EQ(artifact::PredictionBytes(spec), 4 * (25 * (11 * 50 + 2 + 2) + 100 + 1));
}

}  // namespace
}  // namespace maneuver::jobs::job_memory_test
