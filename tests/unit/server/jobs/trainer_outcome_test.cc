#include "server/jobs/trainer_outcome.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <cerrno>
#include <filesystem>
#include <fstream>

#include "maneuver/v1/status.pb.h"
#include "model/files/errno_status.h"
#include "server/errors/error_details.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::jobs::trainer_outcome_test {
namespace {

using testing::HasSubstr;

v1::ErrorInfo InfoOf(const absl::Status& status) {
  v1::ErrorInfo info;
  const v1::Status proto = errors::ToProto(status);
  EXPECT_TRUE(!proto.details().empty() && info.ParseFromString(proto.details(0).value()));
  return info;
}

struct ExitCase {
  int exit_status;
  absl::StatusCode code;
  std::string reason;
};

TEST(TrainerOutcomeTest, EveryExitStatusHasItsReason) {
  EXPECT_TRUE(TrainerStatus({.exit_status = 0, .signal = 0}, "bye").ok());
  const ExitCase cases[] = {
      {64, absl::StatusCode::kInvalidArgument, "INVALID_SETTINGS"},
      {65, absl::StatusCode::kFailedPrecondition, "UNUSABLE_DATA"},
      {66, absl::StatusCode::kFailedPrecondition, "NOT_ENOUGH_EXAMPLES"},
      {70, absl::StatusCode::kInternal, "TRAINER_INTERNAL"},
      {71, absl::StatusCode::kResourceExhausted, "OUT_OF_MEMORY"},
      {73, absl::StatusCode::kResourceExhausted, "DISK_FULL"},
      {74, absl::StatusCode::kFailedPrecondition, "CANNOT_WRITE"},
      {80, absl::StatusCode::kAborted, "TRAINING_DIVERGED"},
      {81, absl::StatusCode::kFailedPrecondition, "ACTIONS_COLLAPSED"},
      {82, absl::StatusCode::kAborted, "METRICS_NOT_FINITE"},
      {83, absl::StatusCode::kUnavailable, "RANK_LOST"},
      {137, absl::StatusCode::kUnavailable, "RANK_LOST"},
      {1, absl::StatusCode::kInternal, "TRAINER_INTERNAL"},
      {127, absl::StatusCode::kInternal, "TRAINER_INTERNAL"},
  };
  for (const ExitCase& c : cases) {
    const absl::Status status = TrainerStatus({.exit_status = c.exit_status, .signal = 0}, "bye");
    EXPECT_EQ(status.code(), c.code) << c.exit_status;
    EXPECT_EQ(InfoOf(status).reason(), c.reason) << c.exit_status;
    EXPECT_THAT(std::string(status.message()), HasSubstr("bye")) << c.exit_status;
  }
}

TEST(TrainerOutcomeTest, NamesTheSignal) {
  const absl::Status killed = TrainerStatus({.exit_status = 0, .signal = SIGKILL}, "");
  EXPECT_EQ(InfoOf(killed).reason(), "TRAINER_DIED");
  EXPECT_EQ(InfoOf(killed).metadata().at("signal"), "9");
  EXPECT_THAT(std::string(killed.message()), HasSubstr("killed by signal 9 (SIGKILL)"));
  EXPECT_THAT(std::string(killed.message()), HasSubstr("memory"));
  EXPECT_THAT(std::string(TrainerStatus({.exit_status = 0, .signal = SIGSEGV}, "").message()),
              HasSubstr("crashed by signal 11"));
}

TEST(TrainerOutcomeTest, ReportsAKillForLackOfMemory) {
  const absl::Status killed = TrainerStatus({.signal = SIGKILL, .out_of_memory = true}, "");
  EXPECT_EQ(InfoOf(killed).reason(), "OUT_OF_MEMORY");
  EXPECT_TRUE(absl::IsResourceExhausted(killed));
  EXPECT_EQ(InfoOf(TrainerStatus({.signal = SIGKILL, .over_memory_limit = true}, "")).reason(),
            "OUT_OF_MEMORY");
}

TEST(TrainerOutcomeTest, AFullDiskIsNotBlamedOnTheTrainer) {
  const absl::Status full = CannotStartTrainer(
      files::ErrnoStatus(ENOSPC, "create", std::filesystem::path("/data/jobs/7/trainer.log")));
  EXPECT_EQ(full.message(), "cannot create trainer.log: the disk is full");
  EXPECT_EQ(InfoOf(full).reason(), "DISK_FULL");
  const absl::Status broken = CannotStartTrainer(
      files::ErrnoStatus(EIO, "create", std::filesystem::path("/data/jobs/7/trainer.log")));
  EXPECT_EQ(InfoOf(broken).reason(), "FOLDER_UNAVAILABLE");
  const absl::Status missing = CannotStartTrainer(
      files::ErrnoStatus(ENOENT, "start", std::filesystem::path("/bin/maneuver-trainer")));
  EXPECT_EQ(InfoOf(missing).reason(), "TRAINER_INTERNAL");
}

TEST(TrainerOutcomeTest, OnlyAForeignSignalOrALostRankIsADeath) {
  EXPECT_TRUE(HasDied({.signal = SIGKILL}));
  EXPECT_TRUE(HasDied({.signal = SIGSEGV}));
  EXPECT_FALSE(HasDied({.signal = SIGKILL, .timed_out = true}));
  EXPECT_FALSE(HasDied({.signal = SIGKILL, .over_memory_limit = true}));
  EXPECT_FALSE(HasDied({.exit_status = 70}));
  EXPECT_TRUE(HasDied({.exit_status = 83}));
  EXPECT_TRUE(HasDied({.exit_status = 137}));  // as srun says it of a task
  EXPECT_FALSE(HasDied({.exit_status = 83, .timed_out = true}));
}

TEST(TrainerOutcomeTest, GivingUpKeepsTheLastReason) {
  const absl::Status status = GaveUp(TrainerStatus({.signal = SIGKILL}, "bye"), 5);
  EXPECT_EQ(InfoOf(status).reason(), "TRAINER_DIED");
  EXPECT_THAT(std::string(status.message()), HasSubstr("5 processes"));
  EXPECT_THAT(std::string(status.message()), HasSubstr("bye"));
}

TEST(TrainerOutcomeTest, RemovesFoldersFromPaths) {
  EXPECT_EQ(WithoutPaths("cannot write /srv/data/jobs/a/output: disk full"),
            "cannot write output: disk full");
  EXPECT_EQ(WithoutPaths("'/a/b/' and (/c/d), --output=/e/f"), "'b' and (d), --output=f");
  EXPECT_EQ(WithoutPaths("datasets/town has 3/4 of jobs/x"), "datasets/town has 3/4 of jobs/x");
  EXPECT_EQ(WithoutPaths("/"), "");
  EXPECT_EQ(WithoutPaths(""), "");
}

class LastLineTest : public testing::Test {
 protected:
  std::string LastLineOf(const std::string& content) {
    std::ofstream(folder_ / "log", std::ios::binary) << content;
    const std::vector<std::string> lines = LastLines(folder_ / "log");
    return lines.empty() ? std::string() : lines.back();
  }
  const TemporaryFolder folder_;
};

TEST_F(LastLineTest, IsTheLastLineWithText) {
  EXPECT_EQ(LastLineOf("first\nsecond\n\n  \n"), "second");
  EXPECT_EQ(LastLineOf("first\nno end"), "no end");
  EXPECT_EQ(LastLineOf(""), "");
  EXPECT_TRUE(LastLines(folder_ / "none").empty());
}

TEST_F(LastLineTest, FindsTheEndOfALongLogAndCutsALongLine) {
  const std::string long_line(100'000, 'x');
  EXPECT_EQ(LastLineOf(long_line + "\nwhy\n"), "why");
  EXPECT_EQ(LastLineOf(long_line).size(), 400u);
}

TEST_F(LastLineTest, KeepsTheLastEightLinesOfThisProcess) {
  LastLineOf("of the one before\n1\n2\n\n3\n");
  EXPECT_EQ(LastLines(folder_ / "log", 18), (std::vector<std::string>{"1", "2", "3"}));
  LastLineOf("1\n2\n3\n4\n5\n6\n7\n8\n9\n10\n");
  EXPECT_EQ(LastLines(folder_ / "log"),
            (std::vector<std::string>{"3", "4", "5", "6", "7", "8", "9", "10"}));
}

TEST_F(LastLineTest, IsValidUtf8WithoutControlCharacters) {
  EXPECT_EQ(LastLineOf("\x1b[1mbold\x07"), " [1mbold ");
  EXPECT_EQ(LastLineOf("gr\xc3\xbc\xc3\x9f \xff \xc3"), "gr\xc3\xbc\xc3\x9f ? ?");
  EXPECT_EQ(LastLineOf("\xe2\x82\xac \xc0\xaf \xed\xa0\x80"), "\xe2\x82\xac ?? ???");
  EXPECT_EQ(LastLineOf("lost /secret/place/file.bin"), "lost file.bin");
}

}  // namespace
}  // namespace maneuver::jobs::trainer_outcome_test
