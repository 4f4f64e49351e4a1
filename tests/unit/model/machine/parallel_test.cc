#include "model/machine/parallel.h"

#include <gtest/gtest.h>

#include <atomic>
#include <latch>
#include <new>
#include <set>
#include <stdexcept>
#include <thread>
#include <vector>

namespace maneuver::machine::parallel_test {
namespace {

TEST(OnThreadsTest, EachCallHasAThreadOfItsOwnTheFirstTheCallers) {
  std::vector<std::thread::id> ids(3);
  std::latch all(3);
  OnThreads(3, [&](int thread) {
    all.arrive_and_wait();  // at the same time
    ids[static_cast<size_t>(thread)] = std::this_thread::get_id();
  });
  EXPECT_EQ(ids[0], std::this_thread::get_id());
  EXPECT_EQ(std::set(ids.begin(), ids.end()).size(), 3u);
}

TEST(OnThreadsTest, ThrowsTheFirstExceptionOnceAllAreDone) {
  for (const int thrower : {0, 2}) {
    std::atomic<int> done = 0;
    EXPECT_THROW(OnThreads(3,
                           [&](int thread) {
                             if (thread == thrower) throw std::bad_alloc();
                             ++done;
                           }),
                 std::bad_alloc);
    EXPECT_EQ(done, 2);
  }
}

TEST(ForEachOnThreadsTest, CallsEachItemOnceWhateverTheNumberOfThreads) {
  for (const int threads : {-1, 0, 1, 2, 7, 2000}) {
    std::vector<std::atomic<int>> calls(500);
    ForEachOnThreads(calls.size(), threads, [&](size_t item) { ++calls[item]; });
    for (const std::atomic<int>& each : calls) EXPECT_EQ(each, 1);
  }
  ForEachOnThreads(0, 4, [](size_t) { FAIL() << "there is no item"; });
}

TEST(ForEachOnThreadsTest, BeginsNoMoreAfterAnError) {
  std::atomic<int> calls = 0;
  const absl::Status status = ForEachOnThreads(1000, 1, [&](size_t item) {
    ++calls;
    return item == 3 ? absl::DataLossError("the fourth") : absl::OkStatus();
  });
  EXPECT_EQ(status.message(), "the fourth");
  EXPECT_EQ(calls, 4);
  EXPECT_TRUE(ForEachOnThreads(9, 3, [](size_t) { return absl::OkStatus(); }).ok());
}

TEST(ForEachOnThreadsTest, ThrowsOn) {
  const auto work = [](size_t item) {
    if (item == 5) throw std::runtime_error("the sixth");
  };
  EXPECT_THROW(ForEachOnThreads(100, 1, work), std::runtime_error);
  EXPECT_THROW(ForEachOnThreads(100, 3, work), std::runtime_error);
}

}  // namespace
}  // namespace maneuver::machine::parallel_test
