#include "server/jobs/job_folder.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "model/files/durable_file.h"
#include "server/jobs/checkpoints.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::jobs::job_folder_test {
namespace {

namespace fs = std::filesystem;

class JobFolderTest : public testing::Test {
 protected:
  static void Write(const fs::path& file, const std::string& text) {
    fs::create_directories(file.parent_path());
    std::ofstream(file) << text;
  }
  fs::path Make(int64_t fence) {
    const auto made = MakeAttemptFolder(job_, fence);
    EXPECT_TRUE(made.ok()) << made.status();
    return made.value_or(fs::path());
  }

  const TemporaryFolder folder_;
  const fs::path job_ = folder_ / "job";
};

TEST_F(JobFolderTest, AnAttemptGoesOnWhereTheLatestOneWas) {
  Write(job_ / kSettingsFile, "settings");
  EXPECT_EQ(LatestAttemptFolder(job_), job_);
  const fs::path first = Make(3);
  EXPECT_EQ(LatestAttemptFolder(job_), first);
  EXPECT_EQ(*files::ReadFile(first / kSettingsFile), "settings");
  Write(first / "checkpoints/checkpoint-7", "seven");
  Write(first / "checkpoints/.checkpoint-8.tmp-0123456789abcdef", "half");
  Write(first / kPromotionFolder / kDecisionFile, "decision");
  Write(first / kOutput / "weights", "unpublished");

  const fs::path second = Make(12);
  EXPECT_EQ(LatestAttemptFolder(job_), second);
  EXPECT_EQ(*files::ReadFile(second / kSettingsFile), "settings");
  EXPECT_EQ(LastCheckpoint(second), 7);
  EXPECT_EQ(*files::ReadFile(second / "checkpoints/checkpoint-7"), "seven");
  EXPECT_FALSE(fs::exists(second / "checkpoints/.checkpoint-8.tmp-0123456789abcdef"));
  EXPECT_EQ(*files::ReadFile(second / kPromotionFolder / kDecisionFile), "decision");
  EXPECT_FALSE(fs::exists(second / kOutput));
  EXPECT_FALSE(fs::exists(first));
}

TEST_F(JobFolderTest, AnAttemptWhoseCheckpointsCannotBeListedStays) {
  Write(job_ / kSettingsFile, "settings");
  const fs::path first = Make(3);
  fs::remove_all(first / "checkpoints");
  Write(first / "checkpoints", "a file in place of the folder");
  EXPECT_FALSE(MakeAttemptFolder(job_, 12).ok());
  EXPECT_EQ(LatestAttemptFolder(job_), first);
  EXPECT_TRUE(fs::exists(first / "checkpoints"));
}

TEST_F(JobFolderTest, AJobOfASingleServerGoesOnFromItsCheckpoints) {
  Write(job_ / kSettingsFile, "settings");
  Write(job_ / "checkpoints/checkpoint-2", "two");
  EXPECT_EQ(LastCheckpoint(Make(1)), 2);
}

TEST_F(JobFolderTest, AnAttemptThatIsLateLeavesTheLaterOneAlone) {
  Write(job_ / kSettingsFile, "settings");
  const fs::path later = Make(12);
  Write(later / "checkpoints/checkpoint-7", "seven");
  const fs::path late = Make(3);
  Write(late / "checkpoints/checkpoint-9", "nine");
  EXPECT_EQ(LatestAttemptFolder(job_), later);
  EXPECT_EQ(LastCheckpoint(later), 7);
}

}  // namespace
}  // namespace maneuver::jobs::job_folder_test
