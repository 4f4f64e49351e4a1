#include "model/files/upload_staging.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <memory>

#include "tests/unit/temporary_folder.h"

namespace maneuver::files::upload_staging_test {
namespace {

namespace fs = std::filesystem;

absl::Status Announce(UploadStaging& staging, UploadStaging::Slot& slot) {
  return staging.Announce(slot, {.announced = 10, .missing = 10},
                          [](const UploadStaging::Others&) { return absl::OkStatus(); });
}

TEST(UploadStagingTest, RemovesAbandonedUploadsBesideWhatIsNoUpload) {
  const TemporaryFolder folder;
  fs::create_directories(folder / ".uploads" / "town.caller");
  std::ofstream(folder / ".uploads" / ".DS_Store") << "stray";
  UploadStaging staging(folder.path());
  const absl::Status status =
      staging.RemoveIf([](const std::string&, fs::file_time_type) { return true; });
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_FALSE(fs::exists(folder / ".uploads" / "town.caller"));
  EXPECT_TRUE(fs::exists(folder / ".uploads" / ".DS_Store"));
}

TEST(UploadStagingTest, TheLatestCallOverAllServersHasTheTurn) {
  const TemporaryFolder folder;
  UploadStaging first(folder.path(), /*is_shared=*/true);
  UploadStaging second(folder.path(), /*is_shared=*/true);
  const auto ours = first.Enter("town", "caller");
  const auto theirs = second.Enter("town", "caller");
  ASSERT_TRUE(Announce(first, *ours).ok());
  EXPECT_TRUE(*first.HasTurn(*ours));
  ASSERT_TRUE(Announce(second, *theirs).ok());
  EXPECT_FALSE(*first.HasTurn(*ours));
  EXPECT_TRUE(*second.HasTurn(*theirs));
}

TEST(UploadStagingTest, AnAnnouncementThatCannotBeWrittenTakesNoTurn) {
  const TemporaryFolder folder;
  UploadStaging staging(folder.path(), /*is_shared=*/true);
  const auto slot = staging.Enter("town", "caller");
  ASSERT_TRUE(Announce(staging, *slot).ok());
  // Nothing can be renamed to the name of a folder that has content.
  const fs::path announced = slot->folder / ".announced";
  fs::rename(announced, folder / "kept");
  fs::create_directories(announced / "content");
  EXPECT_FALSE(Announce(staging, *slot).ok());
  fs::remove_all(announced);
  fs::rename(folder / "kept", announced);
  const absl::StatusOr<bool> has_turn = staging.HasTurn(*slot);
  ASSERT_TRUE(has_turn.ok()) << has_turn.status();
  EXPECT_TRUE(*has_turn);
}

}  // namespace
}  // namespace maneuver::files::upload_staging_test
