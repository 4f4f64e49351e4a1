#include "model/learning/speed_factors.h"

#include <gtest/gtest.h>

#include "tests/unit/model/learning/analytic_scenes.h"

namespace maneuver::learning::speed_factors_test {
namespace {

// Errors of known widths along and across the direction of travel: the factors are the squares of
// the widths over those that were predicted.
TEST(SpeedFactorsTest, FactorsAreFittedPerBinAndWidenedToCover) {
  at::Generator generator = MakeGenerator(9);
  constexpr int64_t kExamples = 12'000, kWaypoints = 5;
  Predictions predictions;
  predictions.speeds = at::cat({at::full({kExamples / 2}, 3.0), at::full({kExamples / 2}, 20.0)});
  const at::Tensor wide = (predictions.speeds > 10.0).view({-1, 1});
  const auto noise = [&](double slow, double fast) {
    return at::empty({kExamples, kWaypoints}).normal_(0.0, 1.0, generator) *
           at::where(wide, at::tensor(fast), at::tensor(slow));
  };
  predictions.trajectories = at::stack({noise(1.0, 2.0), noise(0.5, 0.5)}, 2).flatten(1);
  predictions.log_probabilities = at::zeros({kExamples, 1});
  predictions.log_responsibilities = at::zeros({kExamples, 1});
  predictions.mean = at::zeros({kExamples, 1, kWaypoints, 2});
  predictions.covariance = at::zeros({kExamples, 1, kWaypoints, 3});
  predictions.along = at::tensor({1.0F, 0.0F, 0.0F}).expand({kExamples, 1, kWaypoints, 3});
  predictions.across = at::tensor({0.0F, 0.0F, 1.0F}).expand({kExamples, 1, kWaypoints, 3});
  const at::Tensor factors = FitSpeedFactors(predictions);
  EXPECT_NEAR(factors[2][0].item<double>(), 1.0, 0.15);
  EXPECT_NEAR(factors[2][1].item<double>(), 0.25, 0.05);
  EXPECT_NEAR(factors[5][0].item<double>(), 4.0, 0.6);
  EXPECT_NEAR(factors[5][1].item<double>(), 0.25, 0.05);

  const at::Tensor widened = WidenToCoverBySpeed(predictions, factors, 0.95);
  // A Gaussian holds 1 - exp(-r^2 / 2) within r: 0.95 at r^2 = 5.99 in place of 4.
  EXPECT_NEAR((widened[5][0] / factors[5][0]).item<double>(), 5.99 / 4.0, 0.2);
  // A bin without examples is widened as all of them together.
  EXPECT_NEAR((widened[0][0] / factors[0][0]).item<double>(), 5.99 / 4.0, 0.2);
}

TEST(SpeedBinsTest, BinsBeginAtTheirLowerBounds) {
  EXPECT_TRUE(SpeedBins(at::tensor({0.0F, 0.5F, -3.0F, 9.9F, 14.0F, 40.0F}))
                  .equal(at::tensor({0, 1, 2, 3, 4, 5}, at::kLong)));
}

}  // namespace
}  // namespace maneuver::learning::speed_factors_test
