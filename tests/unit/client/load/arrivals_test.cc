#include "client/load/arrivals.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

namespace maneuver::load::arrivals_test {
namespace {

using std::chrono::nanoseconds;

TEST(ArrivalsTest, ConstantArrivalsDoNotDrift) {
  Arrivals arrivals(ArrivalProcess::kConstant, 3.0, 1);
  EXPECT_EQ(arrivals.Next(), nanoseconds(0));
  EXPECT_EQ(arrivals.Next(), nanoseconds(333'333'333));
  nanoseconds last{0};
  for (int i = 2; i <= 3'000'000; ++i) last = arrivals.Next();
  EXPECT_EQ(last, std::chrono::seconds(1'000'000));
}

TEST(ArrivalsTest, GapsOfPoissonArrivalsAreExponential) {
  constexpr int kCalls = 200'000;
  constexpr double kRate = 250.0;
  Arrivals arrivals(ArrivalProcess::kPoisson, kRate, 7);
  double sum = 0.0;
  double squares = 0.0;
  std::map<double, int> longer = {{0.1, 0}, {1.0, 0}, {3.0, 0}};  // in mean gaps
  nanoseconds last{0};
  for (int i = 0; i < kCalls; ++i) {
    const nanoseconds next = arrivals.Next();
    ASSERT_GE(next, last);
    const double gap = std::chrono::duration<double>(next - last).count() * kRate;
    last = next;
    sum += gap;
    squares += gap * gap;
    for (auto& [length, count] : longer) count += gap > length ? 1 : 0;
  }
  // Standard errors: 0.0022 of the mean, 0.01 of the second moment, at most 0.0011 of the shares.
  EXPECT_NEAR(sum / kCalls, 1.0, 0.01);
  EXPECT_NEAR(squares / kCalls, 2.0, 0.04);
  for (const auto& [length, count] : longer) {
    EXPECT_NEAR(static_cast<double>(count) / kCalls, std::exp(-length), 0.005) << length;
  }
}

TEST(ArrivalsTest, TheSeedDecidesTheTimes) {
  Arrivals one(ArrivalProcess::kPoisson, 10.0, 5);
  Arrivals same(ArrivalProcess::kPoisson, 10.0, 5);
  Arrivals other(ArrivalProcess::kPoisson, 10.0, 6);
  for (int i = 0; i < 100; ++i) {
    const nanoseconds due = one.Next();
    EXPECT_EQ(due, same.Next());
    EXPECT_NE(due, other.Next());
  }
}

}  // namespace
}  // namespace maneuver::load::arrivals_test
