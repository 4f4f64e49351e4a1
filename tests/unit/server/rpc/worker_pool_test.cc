#include "server/rpc/worker_pool.h"

#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <thread>

namespace maneuver::rpc::worker_pool_test {
namespace {

TEST(WorkerPoolTest, RunsAcceptedWorkBeforeItEnds) {
  std::atomic<int> runs = 0;
  {
    WorkerPool pool(2, 100);
    for (int i = 0; i < 50; ++i) EXPECT_TRUE(pool.Post([&] { ++runs; }));
  }
  EXPECT_EQ(runs, 50);
}

TEST(WorkerPoolTest, RefusesWorkBeyondTheLimitButNoContinuation) {
  std::promise<void> started;
  std::promise<void> release;
  std::atomic<int> runs = 0;
  {
    WorkerPool pool(1, 1);
    ASSERT_TRUE(pool.Post([&] {
      started.set_value();
      release.get_future().wait();
    }));
    started.get_future().wait();
    EXPECT_TRUE(pool.Post([&] { ++runs; }));
    EXPECT_FALSE(pool.Post([&] { ++runs; }));
    pool.Continue([&] { ++runs; });
    release.set_value();
  }
  EXPECT_EQ(runs, 2);
}

TEST(WorkerPoolTest, ReservedWorkHasTwiceTheLimits) {
  std::promise<void> started;
  std::promise<void> release;
  std::atomic<int> runs = 0;
  {
    WorkerPool pool(1, 2, 100);
    ASSERT_TRUE(pool.Post([&] {
      started.set_value();
      release.get_future().wait();
    }));
    started.get_future().wait();
    EXPECT_TRUE(pool.Post([&] { ++runs; }, 60));
    EXPECT_FALSE(pool.Post([&] { ++runs; }, 60));
    EXPECT_TRUE(pool.PostReserved([&] { ++runs; }, 60));
    EXPECT_FALSE(pool.Post([&] { ++runs; }));
    EXPECT_FALSE(pool.PostReserved([&] { ++runs; }, 100));
    EXPECT_TRUE(pool.PostReserved([&] { ++runs; }));
    EXPECT_TRUE(pool.PostReserved([&] { ++runs; }));
    EXPECT_FALSE(pool.PostReserved([&] { ++runs; }));
    release.set_value();
  }
  EXPECT_EQ(runs, 4);
}

TEST(WorkerPoolTest, RefusesWorkThatTogetherKeepsTooMuchInMemory) {
  std::promise<void> started;
  std::promise<void> release;
  WorkerPool pool(1, 10, 100);
  // Alone it may keep any number of bytes, and keeps them while it runs.
  ASSERT_TRUE(pool.Post(
      [&] {
        started.set_value();
        release.get_future().wait();
      },
      150));
  started.get_future().wait();
  EXPECT_FALSE(pool.Post([] {}, 1));
  EXPECT_TRUE(pool.Post([] {}));
  release.set_value();
  std::promise<void> ran;
  while (!pool.Post([&] { ran.set_value(); }, 60)) std::this_thread::yield();
  ran.get_future().wait();
}

}  // namespace
}  // namespace maneuver::rpc::worker_pool_test
