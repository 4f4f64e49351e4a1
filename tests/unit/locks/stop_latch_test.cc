#include "locks/stop_latch.h"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

namespace maneuver::stop_latch_test {
namespace {

using std::chrono::hours;
using std::chrono::nanoseconds;

TEST(StopLatchTest, SaysThatTheTimeIsOver) {
  StopLatch stop;
  EXPECT_FALSE(stop.StoppedWithin(nanoseconds(1)));
}

TEST(StopLatchTest, EndsAWaitThatIsUnderWay) {
  StopLatch stop;
  bool stopped = false;
  std::jthread waiter([&] { stopped = stop.StoppedWithin(hours(24)); });
  stop.Stop();
  waiter.join();
  EXPECT_TRUE(stopped);
}

TEST(StopLatchTest, EndsLaterWaitsAtOnce) {
  StopLatch stop;
  stop.Stop();
  EXPECT_TRUE(stop.StoppedWithin(hours(24)));
  EXPECT_TRUE(stop.StoppedWithin(nanoseconds(0)));
}

TEST(StopLatchTest, AWakeEndsOneWaitWithoutStopping) {
  StopLatch latch;
  latch.Wake();
  latch.Wake();
  EXPECT_FALSE(latch.StoppedWithin(std::chrono::hours(1)));
  EXPECT_FALSE(latch.StoppedWithin(std::chrono::milliseconds(1)));
  std::thread waker([&] { latch.Wake(); });
  EXPECT_FALSE(latch.StoppedWithin(std::chrono::hours(1)));
  waker.join();
  latch.Wake();
  latch.Stop();
  EXPECT_TRUE(latch.StoppedWithin(std::chrono::hours(1)));
}

}  // namespace
}  // namespace maneuver::stop_latch_test
