// Not built with sanitizers, whose allocators are not glibc's.

#include <gtest/gtest.h>

#include <memory>
#include <utility>
#include <vector>

#include "server/monitoring/process_metrics.h"

namespace maneuver::monitoring::allocated_memory_test {
namespace {

TEST(AllocatedMemoryTest, FreedMemoryIsNotAllocated) {
  constexpr size_t kBlocks = 1000;
  constexpr size_t kBytes = 10'000;  // so few that glibc keeps freed blocks
  const auto before = ReadProcessMetrics();
  std::vector<std::unique_ptr<char[]>> blocks;
  for (size_t i = 0; i < kBlocks; ++i) blocks.push_back(std::make_unique<char[]>(kBytes));
  std::unique_ptr<char[]> last = std::move(blocks.back());  // the heap's end is not given back
  const auto full = ReadProcessMetrics();
  blocks.clear();
  const auto after = ReadProcessMetrics();
  ASSERT_TRUE(before && full && after);
  EXPECT_NEAR(full->allocated_bytes - before->allocated_bytes, kBlocks * kBytes, 1e6);
  EXPECT_NEAR(after->allocated_bytes - before->allocated_bytes, 0.0, 1e6);
  EXPECT_NEAR(after->resident_bytes, full->resident_bytes, 1e6);
}

}  // namespace
}  // namespace maneuver::monitoring::allocated_memory_test
