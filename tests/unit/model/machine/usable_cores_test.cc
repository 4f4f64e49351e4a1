#include "model/machine/usable_cores.h"

#include <gtest/gtest.h>
#include <sched.h>

#include <fstream>
#include <string>
#include <thread>

#include "tests/unit/temporary_folder.h"

namespace maneuver::machine::usable_cores_test {
namespace {

namespace fs = std::filesystem;

class GroupLimitTest : public testing::Test {
 protected:
  void SetUp() override { fs::create_directories(root_ / "pod/container"); }

  void Write(const fs::path& group, const std::string& text) {
    std::ofstream(root_ / group / "cpu.max") << text << "\n";
  }
  std::optional<double> Limit() const { return GroupLimit(root_.path(), "/pod/container"); }

  const TemporaryFolder root_;
};

TEST_F(GroupLimitTest, ReturnsNothingWithoutALimit) {
  EXPECT_EQ(Limit(), std::nullopt);
  Write("pod", "max 100000");
  Write("pod/container", "nonsense");
  EXPECT_EQ(Limit(), std::nullopt);
}

TEST_F(GroupLimitTest, ReturnsTheSmallestLimitOfAllEnclosingGroups) {
  Write("pod/container", "max 100000");
  Write("pod", "150000 100000");
  EXPECT_EQ(Limit(), 1.5);
  Write("pod/container", "50000 100000");
  EXPECT_EQ(Limit(), 0.5);
  Write("", "20000 100000");
  EXPECT_EQ(Limit(), 0.2);
}

TEST(UsableCoresTest, FollowsTheThreadsAffinity) {
  EXPECT_GE(UsableCores(), 1);
  EXPECT_LE(UsableCores(), static_cast<int>(std::thread::hardware_concurrency()));
  std::thread([] {
    cpu_set_t all;
    ASSERT_EQ(sched_getaffinity(0, sizeof(all), &all), 0);
    cpu_set_t one;
    CPU_ZERO(&one);
    for (int core = 0; core < CPU_SETSIZE && CPU_COUNT(&one) == 0; ++core) {
      if (CPU_ISSET(core, &all)) CPU_SET(core, &one);
    }
    ASSERT_EQ(sched_setaffinity(0, sizeof(one), &one), 0);
    EXPECT_EQ(UsableCores(), 1);
  }).join();
}

}  // namespace
}  // namespace maneuver::machine::usable_cores_test
