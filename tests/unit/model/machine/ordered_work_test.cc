#include "model/machine/ordered_work.h"

#include <gtest/gtest.h>

#include <atomic>
#include <latch>
#include <new>
#include <optional>
#include <string>
#include <thread>

namespace maneuver::machine::ordered_work_test {
namespace {

TEST(OrderedWorkTest, HandsResultsOutInOrder) {
  OrderedWork<std::string> work(2, 2);
  EXPECT_EQ(work.Claim(), 0);
  EXPECT_EQ(work.Claim(), 1);
  work.Put(1, "second");
  EXPECT_FALSE(work.IsReady());
  work.Put(0, "first");
  EXPECT_TRUE(work.IsReady());
  EXPECT_EQ(work.Take(), "first");
  EXPECT_EQ(work.Take(), "second");
  EXPECT_EQ(work.Take(), std::nullopt);
}

TEST(OrderedWorkTest, GivesEachItemToOneOfManyThreads) {
  constexpr size_t kItems = 1000;
  OrderedWork<size_t> work(kItems, 8);
  for (int i = 0; i < 4; ++i) {
    work.Start([&work] {
      while (const std::optional<size_t> item = work.Claim()) work.Put(*item, *item * *item);
    });
  }
  for (size_t i = 0; i < kItems; ++i) EXPECT_EQ(work.Take(), i * i);
  EXPECT_EQ(work.Take(), std::nullopt);
}

TEST(OrderedWorkTest, ClaimsNoMoreThanMayBeAhead) {
  OrderedWork<int> work(3, 1);
  EXPECT_EQ(work.Claim(), 0);
  work.Put(0, 7);
  std::latch begun(1);
  std::atomic<bool> takes = false;
  std::optional<size_t> claimed;
  bool claimed_after = false;
  std::jthread claimer([&] {
    begun.count_down();
    claimed = work.Claim();
    claimed_after = takes;
  });
  begun.wait();
  takes = true;
  EXPECT_EQ(work.Take(), 7);
  claimer.join();
  EXPECT_EQ(claimed, 1);
  EXPECT_TRUE(claimed_after);
}

TEST(OrderedWorkTest, ClaimsNothingOnceAllAreClaimed) {
  OrderedWork<int> work(1, 4);
  EXPECT_EQ(work.Claim(), 0);
  EXPECT_EQ(work.Claim(), std::nullopt);
}

TEST(OrderedWorkTest, EndsThreadsThatWaitToClaim) {
  std::optional<size_t> claimed = 0;
  {
    OrderedWork<int> work(2, 1);
    EXPECT_EQ(work.Claim(), 0);
    work.Start([&] { claimed = work.Claim(); });
  }
  EXPECT_EQ(claimed, std::nullopt);
}

TEST(OrderedWorkTest, ThrowsWhatAThreadThrewAndEndsTheOthers) {
  std::optional<size_t> claimed = 0;
  OrderedWork<int> work(3, 2);
  EXPECT_EQ(work.Claim(), 0);
  EXPECT_EQ(work.Claim(), 1);
  work.Start([&] { claimed = work.Claim(); });
  work.Start([] { throw std::bad_alloc(); });
  EXPECT_THROW(work.Take(), std::bad_alloc);
  EXPECT_TRUE(work.IsReady());
  EXPECT_THROW(work.Take(), std::bad_alloc);
  EXPECT_EQ(work.Claim(), std::nullopt);
}

}  // namespace
}  // namespace maneuver::machine::ordered_work_test
