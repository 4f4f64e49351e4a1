#include "server/maneuverd/data_lock.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "tests/unit/temporary_folder.h"

namespace maneuver::data_lock_test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::IsEmpty;

class CloseToOthersTest : public testing::Test {
 protected:
  // Returns the mode after CloseToOthers; what that says is in said_.
  fs::perms ModeAfter(fs::perms before, bool is_shared) {
    const fs::path data = folder_ / "data";
    fs::create_directories(data);
    fs::permissions(data, before);
    said_ = CloseToOthers(data, is_shared);
    return fs::status(data).permissions();
  }

  const TemporaryFolder folder_;
  std::string said_;
};

TEST_F(CloseToOthersTest, ClosesAFolderThatOthersCanEnter) {
  EXPECT_EQ(ModeAfter(fs::perms{0755}, false), fs::perms{0700});
  EXPECT_THAT(said_, HasSubstr("its mode is 700 now"));
  EXPECT_EQ(ModeAfter(fs::perms{0751}, false), fs::perms{0700});
}

TEST_F(CloseToOthersTest, LeavesAFolderThatOnlyAGroupCanEnter) {
  EXPECT_EQ(ModeAfter(fs::perms{0750}, false), fs::perms{0750});
  EXPECT_THAT(said_, IsEmpty());
  EXPECT_EQ(ModeAfter(fs::perms{0750}, true), fs::perms{0750});
  EXPECT_THAT(said_, IsEmpty());
}

TEST_F(CloseToOthersTest, WarnsOfASharedFolderAndLeavesItOpen) {
  EXPECT_EQ(ModeAfter(fs::perms{0775}, true), fs::perms{0775});
  EXPECT_THAT(said_, HasSubstr("other users can enter the data folder"));
}

}  // namespace
}  // namespace maneuver::data_lock_test
