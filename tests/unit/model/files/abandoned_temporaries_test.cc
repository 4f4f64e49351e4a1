#include "model/files/abandoned_temporaries.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "model/files/durable_file.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::files::abandoned_temporaries_test {
namespace {

namespace fs = std::filesystem;

TEST(AbandonedTemporariesTest, RemovesTemporariesThatNobodyWritesAnyMore) {
  const TemporaryFolder folder;
  const auto temporary = MakeTemporaryFolderFor(folder / "town");
  ASSERT_TRUE(temporary.ok()) << temporary.status();
  std::ofstream(*temporary / "shard") << "bytes";
  std::ofstream(folder / "town.tmp-is-no-temporary") << "bytes";
  const auto written = fs::last_write_time(*temporary);

  RemoveAbandonedTemporaries(folder.path(), written + kAbandonedAfter - std::chrono::seconds(1));
  EXPECT_TRUE(fs::exists(*temporary / "shard"));
  RemoveAbandonedTemporaries(folder.path(), written + kAbandonedAfter);
  EXPECT_FALSE(fs::exists(*temporary));
  EXPECT_TRUE(fs::exists(folder / "town.tmp-is-no-temporary"));
}

}  // namespace
}  // namespace maneuver::files::abandoned_temporaries_test
