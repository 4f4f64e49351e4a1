#include "server/serving/drain_rate.h"

#include <gtest/gtest.h>

namespace maneuver::serving::drain_rate_test {
namespace {

using std::chrono::duration;
using std::chrono::milliseconds;

constexpr TimePoint kStart{std::chrono::hours(1)};

double Seconds(std::chrono::nanoseconds time) { return duration<double>(time).count(); }

TEST(DrainRateTest, ExpectsNoWaitBeforeTheFirstBatch) {
  DrainRate rate(2);
  EXPECT_EQ(rate.TimeFor(100, kStart).count(), 0);
}

TEST(DrainRateTest, AddsTheRatesOfWorkers) {
  DrainRate rate(2);
  TimePoint now = kStart;
  for (int i = 0; i < 3; ++i) {
    rate.Begin(0, 4, now);
    rate.Begin(1, 8, now);
    now += milliseconds(100);
    rate.End(0, now);
    now += milliseconds(100);
    rate.End(1, now);
  }
  // 25 ms a target of one worker.
  EXPECT_NEAR(Seconds(rate.TimeFor(40, now)), 40 * 0.025 / 2, 1e-3);
}

TEST(DrainRateTest, IdleTimeDoesNotCount) {
  DrainRate rate(1);
  rate.Begin(0, 1, kStart);
  rate.End(0, kStart + milliseconds(10));
  const TimePoint later = kStart + std::chrono::hours(1);
  EXPECT_NEAR(Seconds(rate.TimeFor(100, later)), 1.0, 1e-6);
  rate.Begin(0, 1, later);
  rate.End(0, later + milliseconds(10));
  EXPECT_NEAR(Seconds(rate.TimeFor(100, later)), 1.0, 1e-6);
}

TEST(DrainRateTest, CountsASlowBatchBeforeItEnds) {
  DrainRate rate(2);
  rate.Begin(0, 10, kStart);
  rate.End(0, kStart + milliseconds(100));  // 10 ms a target, 200 targets a second by two workers
  rate.Begin(0, 10, kStart + milliseconds(100));
  EXPECT_NEAR(Seconds(rate.TimeFor(100, kStart + milliseconds(150))), 0.5, 1e-6);
  // After 1 s at work that worker does 10 targets a second at most.
  EXPECT_NEAR(Seconds(rate.TimeFor(110, kStart + milliseconds(1100))), 1.0, 1e-6);
}

TEST(DrainRateTest, PredictsTheRestOfBatchesInProgress) {
  DrainRate rate(2);
  rate.Begin(0, 10, kStart);
  rate.End(0, kStart + milliseconds(100));  // 10 ms a target
  EXPECT_EQ(rate.TimeForWorkBegun(kStart + milliseconds(100)).count(), 0);
  rate.Begin(0, 10, kStart + milliseconds(100));
  EXPECT_FALSE(rate.AllAtWork());
  rate.Begin(1, 4, kStart + milliseconds(120));
  EXPECT_TRUE(rate.AllAtWork());
  // 70 and 30 ms of one worker, by two.
  EXPECT_NEAR(Seconds(rate.TimeForWorkBegun(kStart + milliseconds(130))), 0.05, 1e-6);
  EXPECT_EQ(rate.TimeForWorkBegun(kStart + milliseconds(300)).count(), 0);
}

TEST(DrainRateTest, AdaptsToAnotherSpeedWithinSeconds) {
  DrainRate rate(1);
  TimePoint now = kStart;
  const auto work = [&](milliseconds each, int batches) {
    for (int i = 0; i < batches; ++i) {
      rate.Begin(0, 8, now);
      now += 8 * each;
      rate.End(0, now);
    }
  };
  work(milliseconds(1), 1000);
  EXPECT_NEAR(Seconds(rate.TimeFor(1000, now)), 1.0, 1e-3);
  work(milliseconds(20), 63);  // 10 s
  EXPECT_NEAR(Seconds(rate.TimeFor(1000, now)), 20.0, 2.5);
}

}  // namespace
}  // namespace maneuver::serving::drain_rate_test
