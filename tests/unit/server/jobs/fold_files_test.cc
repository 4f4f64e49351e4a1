#include "server/jobs/trainer/fold_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "tests/unit/temporary_folder.h"

namespace maneuver::trainer::fold_files_test {
namespace {

using testing::HasSubstr;

v1::FoldRun RunOf(int fold) {
  v1::FoldRun run;
  run.set_seed(1);
  run.set_fold(fold);
  return run;
}

class FoldFilesTest : public testing::Test {
 protected:
  FoldFilesTest() {
    plan_.set_folds(2);
    plan_.add_seeds(1);
    plan_.add_dataset_names("city");
    plan_.add_dataset_names("motorway");
    for (int i = 0; i < 2; ++i) {
      v1::GroupedRecording& recording = *plan_.add_recordings();
      recording.set_scenario_id(std::to_string(i));
      recording.set_group(i);
      recording.set_fold(i);
      recording.set_dataset(i);
    }
  }

  v1::CrossValidationPlan plan_;
  const TemporaryFolder folder_;
  const std::filesystem::path files_ = folder_.path() / "folds";
};

TEST_F(FoldFilesTest, KeepsEachRunAndGoesOnAfterThem) {
  auto files = FoldFiles::Open(files_, plan_);
  ASSERT_TRUE(files.ok()) << files.status();
  EXPECT_TRUE(files->runs().empty());
  ASSERT_TRUE(files->Add(RunOf(0)).ok());
  auto again = FoldFiles::Open(files_, plan_);
  ASSERT_TRUE(again.ok()) << again.status();
  ASSERT_TRUE(again->Add(RunOf(1)).ok());
  const auto last = FoldFiles::Open(files_, plan_);
  ASSERT_TRUE(last.ok()) << last.status();
  ASSERT_EQ(last->runs().size(), 2u);
  EXPECT_EQ(last->runs()[0].fold(), 0);
  EXPECT_EQ(last->runs()[1].fold(), 1);
}

// Plans of programs before 2026-11-27 neither name the datasets nor say which recording is of which.
TEST_F(FoldFilesTest, GoesOnWithTheRunsOfAnOlderProgram) {
  v1::CrossValidationPlan older = plan_;
  older.clear_dataset_names();
  for (v1::GroupedRecording& recording : *older.mutable_recordings()) recording.clear_dataset();
  auto files = FoldFiles::Open(files_, older);
  ASSERT_TRUE(files.ok()) << files.status();
  ASSERT_TRUE(files->Add(RunOf(0)).ok());
  const auto newer = FoldFiles::Open(files_, plan_);
  ASSERT_TRUE(newer.ok()) << newer.status();
  EXPECT_EQ(newer->runs().size(), 1u);
}

TEST_F(FoldFilesTest, RefusesRunsOfAnotherCrossValidation) {
  auto files = FoldFiles::Open(files_, plan_);
  ASSERT_TRUE(files.ok()) << files.status();
  ASSERT_TRUE(files->Add(RunOf(0)).ok());
  v1::CrossValidationPlan other = plan_;
  other.mutable_settings()->set_preset("compact");
  EXPECT_THAT(FoldFiles::Open(files_, other).status().message(),
              HasSubstr("checkpoint-1 is of other settings"));
  other = plan_;
  other.add_seeds(2);
  EXPECT_THAT(FoldFiles::Open(files_, other).status().message(), HasSubstr("name an empty folder"));
}

TEST_F(FoldFilesTest, NamesADamagedFile) {
  auto files = FoldFiles::Open(files_, plan_);
  ASSERT_TRUE(files.ok()) << files.status();
  for (int fold = 0; fold < 2; ++fold) ASSERT_TRUE(files->Add(RunOf(fold)).ok());
  std::ofstream(files_ / "checkpoint-2") << "not a part";
  const absl::Status status = FoldFiles::Open(files_, plan_).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(status.message(), HasSubstr("checkpoint-2 is damaged; remove it"));
}

}  // namespace
}  // namespace maneuver::trainer::fold_files_test
