#include "server/security/rate_limiter.h"

#include <gtest/gtest.h>

#include <string>

namespace maneuver::security::rate_limiter_test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

class RateLimiterTest : public ::testing::Test {
 protected:
  RateLimiter Limiter(double per_second) {
    return RateLimiter(per_second, [this] { return now_; });
  }

  SteadyTime now_{};
};

TEST_F(RateLimiterTest, AllowsABurstOfOneSecondAndThenTheRate) {
  RateLimiter limiter = Limiter(4.0);
  for (int i = 0; i < 4; ++i) EXPECT_FALSE(limiter.Take("a", 1.0)) << i;
  EXPECT_EQ(limiter.Take("a", 1.0), milliseconds(250));
  now_ += milliseconds(100);
  EXPECT_EQ(limiter.Take("a", 1.0), milliseconds(150));
  // A caller that waits exactly as long as told gets one call, and no more.
  now_ += milliseconds(150);
  EXPECT_FALSE(limiter.Take("a", 1.0));
  EXPECT_TRUE(limiter.Take("a", 1.0));
  // An hour away earns at most one second's worth.
  now_ += std::chrono::hours(1);
  for (int i = 0; i < 4; ++i) EXPECT_FALSE(limiter.Take("a", 1.0)) << i;
  EXPECT_TRUE(limiter.Take("a", 1.0));
}

TEST_F(RateLimiterTest, LimitsEachClientSeparately) {
  RateLimiter limiter = Limiter(1.0);
  EXPECT_FALSE(limiter.Take("a", 1.0));
  EXPECT_TRUE(limiter.Take("a", 1.0));
  EXPECT_FALSE(limiter.Take("b", 1.0));
}

TEST_F(RateLimiterTest, AdmitsALargeRequestThatIsThenPaidOff) {
  RateLimiter limiter = Limiter(100.0);
  EXPECT_FALSE(limiter.Take("a", 1000.0));
  // 900 below zero, and one is needed.
  EXPECT_EQ(limiter.Take("a", 1.0), milliseconds(9010));
  now_ += milliseconds(9010);
  EXPECT_FALSE(limiter.Take("a", 1.0));
}

TEST_F(RateLimiterTest, RatesBelowOnePerSecondAdmitOneCall) {
  RateLimiter limiter = Limiter(0.1);
  EXPECT_FALSE(limiter.Take("a", 1.0));
  EXPECT_EQ(limiter.Take("a", 1.0), seconds(10));
}

TEST_F(RateLimiterTest, AdmitsEverythingWithoutALimit) {
  RateLimiter limiter = Limiter(0.0);
  for (int i = 0; i < 1000; ++i) EXPECT_FALSE(limiter.Take("a", 1e9));
  EXPECT_EQ(limiter.clients(), 0u);
}

TEST_F(RateLimiterTest, ForgetsTheLeastRecentClientWhenFull) {
  RateLimiter limiter = Limiter(1.0);
  EXPECT_FALSE(limiter.Take("first", 1.0));
  EXPECT_FALSE(limiter.Take("second", 1.0));
  EXPECT_TRUE(limiter.Take("first", 1.0));  // most recently used
  for (size_t i = 0; i + 1 < RateLimiter::kMaxClients; ++i) {
    limiter.Take("client" + std::to_string(i), 1.0);
  }
  EXPECT_EQ(limiter.clients(), RateLimiter::kMaxClients);
  EXPECT_TRUE(limiter.Take("first", 1.0)) << "still remembered";
  EXPECT_FALSE(limiter.Take("second", 1.0)) << "forgotten";
  EXPECT_EQ(limiter.clients(), RateLimiter::kMaxClients);
}

}  // namespace
}  // namespace maneuver::security::rate_limiter_test
