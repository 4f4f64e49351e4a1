#include "model/machine/usable_memory.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/unit/temporary_folder.h"

namespace maneuver::machine::usable_memory_test {
namespace {

TEST(UsableMemoryTest, ReturnsTheSmallestLimitOfAllEnclosingGroups) {
  const TemporaryFolder root;
  std::filesystem::create_directories(root / "pod/container");
  const auto limit = [&] { return GroupMemoryLimit(root.path(), "/pod/container"); };
  EXPECT_EQ(limit(), std::nullopt);
  std::ofstream(root / "pod/container/memory.max") << "max\n";
  EXPECT_EQ(limit(), std::nullopt);
  std::ofstream(root / "pod/container/memory.max") << "3221225472\n";
  EXPECT_EQ(limit(), int64_t{3} << 30);
  std::ofstream(root / "pod/memory.max") << "1073741824\n";
  EXPECT_EQ(limit(), int64_t{1} << 30);
}

TEST(UsableMemoryTest, IsThatOfThisMachineOrLess) {
  std::ifstream info("/proc/meminfo");
  std::string name;
  int64_t kibibytes = 0;
  info >> name >> kibibytes;
  ASSERT_EQ(name, "MemTotal:");
  EXPECT_GT(UsableMemory(), 0);
  EXPECT_LE(UsableMemory(), kibibytes << 10);
}

}  // namespace
}  // namespace maneuver::machine::usable_memory_test
