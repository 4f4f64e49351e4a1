#include "model/data/town/signals.h"

#include "gtest/gtest.h"

namespace maneuver::data::town::signals_test {
namespace {

SignalPlan Plan() {
  SignalPlan plan;
  plan.green = {12.0, 9.0};
  plan.yellow = 3.0;
  plan.all_red = 2.0;
  plan.offset = 4.0;
  return plan;
}

TEST(SignalsTest, OnlyOneGroupEverHasRightOfWay) {
  const SignalPlan plan = Plan();
  for (double t = -40.0; t < 80.0; t += 0.1) {
    EXPECT_TRUE(plan.At(0, t) == Light::kRed || plan.At(1, t) == Light::kRed) << t;
  }
}

TEST(SignalsTest, LightsFollowThePlan) {
  const SignalPlan plan = Plan();
  EXPECT_EQ(plan.At(0, 3.9), Light::kRed);
  EXPECT_EQ(plan.At(0, 4.1), Light::kGreen);
  EXPECT_EQ(plan.At(0, 15.9), Light::kGreen);
  EXPECT_EQ(plan.At(0, 16.1), Light::kYellow);
  EXPECT_EQ(plan.At(0, 19.1), Light::kRed);
  EXPECT_EQ(plan.At(1, 20.9), Light::kRed);
  EXPECT_EQ(plan.At(1, 21.1), Light::kGreen);
  EXPECT_EQ(plan.At(1, 30.1), Light::kYellow);
  EXPECT_EQ(plan.At(0, 4.1 + plan.Cycle()), Light::kGreen);
}

TEST(SignalsTest, TimeUntilGreenEndsInGreen) {
  const SignalPlan plan = Plan();
  EXPECT_DOUBLE_EQ(plan.UntilGreen(0, 10.0), 0.0);
  EXPECT_NEAR(plan.UntilGreen(1, 10.0), 11.0, 1e-9);
}

}  // namespace
}  // namespace maneuver::data::town::signals_test
