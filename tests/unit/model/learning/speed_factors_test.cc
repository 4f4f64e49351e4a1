#include "model/learning/speed_factors.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/model/learning/analytic_scenes.h"

namespace maneuver::learning::speed_factors_test {
namespace {

// Predictions of one action at the origin with a deviation of 1 m along x and across it.
//   speeds: m/s, [N]
//   along, across: deviations of what happened, m, [N]
Predictions OfKnownErrors(const at::Tensor& speeds, const at::Tensor& along,
                          const at::Tensor& across, at::Generator& generator) {
  constexpr int64_t kWaypoints = 5;
  const int64_t examples = speeds.size(0);
  const auto errors = [&](const at::Tensor& deviation) {
    return at::empty({examples, kWaypoints}).normal_(0.0, 1.0, generator) * deviation.view({-1, 1});
  };
  Predictions predictions;
  predictions.speeds = speeds;
  predictions.trajectories = at::stack({errors(along), errors(across)}, 2).flatten(1);
  predictions.log_probabilities = at::zeros({examples, 1});
  predictions.log_responsibilities = at::zeros({examples, 1});
  predictions.mean = at::zeros({examples, 1, kWaypoints, 2});
  predictions.covariance = at::zeros({examples, 1, kWaypoints, 3});
  predictions.along = at::tensor({1.0F, 0.0F, 0.0F}).expand({examples, 1, kWaypoints, 3});
  predictions.across = at::tensor({0.0F, 0.0F, 1.0F}).expand({examples, 1, kWaypoints, 3});
  return predictions;
}

// The factors are the squares of the true deviations over those that were predicted.
TEST(SpeedFactorsTest, FactorsAreFittedPerBinAndScaledToCover) {
  at::Generator generator = MakeGenerator(9);
  const at::Tensor speeds = at::cat({at::full({6'000}, 3.0), at::full({6'000}, 20.0)});
  const Predictions predictions = OfKnownErrors(speeds, at::where(speeds > 10.0, 2.0, 1.0),
                                                at::full_like(speeds, 0.5), generator);
  const at::Tensor factors = FitSpeedFactors(predictions);
  EXPECT_NEAR(factors[2][0].item<double>(), 1.0, 0.15);
  EXPECT_NEAR(factors[2][1].item<double>(), 0.25, 0.05);
  EXPECT_NEAR(factors[5][0].item<double>(), 4.0, 0.6);
  EXPECT_NEAR(factors[5][1].item<double>(), 0.25, 0.05);

  const at::Tensor scaled = ScaleToCoverBySpeed(predictions, factors, 0.95);
  // A Gaussian holds 1 - exp(-r^2 / 2) within r: 0.95 at r^2 = 5.99 in place of 4.
  EXPECT_NEAR((scaled[5][0] / factors[5][0]).item<double>(), 5.99 / 4.0, 0.2);
  // No example stands: that bin is scaled as all of them together.
  EXPECT_NEAR((scaled[0][0] / factors[0][0]).item<double>(), 5.99 / 4.0, 0.2);
}

// A third of the vehicles stands. Their predicted deviation is 3 times too large, that of the
// others 2 times too small.
TEST(SpeedFactorsTest, VehiclesThatStandAreScaledApartFromThoseThatMove) {
  at::Generator generator = MakeGenerator(11);
  const at::Tensor speeds =
      at::cat({at::full({3'000}, 0.1), at::full({3'000}, 4.0), at::full({3'000}, 18.0)});
  const at::Tensor deviation = at::where(speeds < 0.5, 1.0 / 3.0, 2.0);
  const Predictions predictions = OfKnownErrors(speeds, deviation, deviation, generator);
  const at::Tensor scaled =
      ScaleToCoverBySpeed(predictions, at::ones({6, 2}), 1.0 - std::exp(-2.0));
  EXPECT_NEAR(scaled[0][0].item<double>(), 1.0 / 9.0, 0.01);
  EXPECT_NEAR(scaled[2][1].item<double>(), 4.0, 0.2);
  EXPECT_TRUE(scaled[5].equal(scaled[2]));
}

TEST(SpeedBinsTest, BinsBeginAtTheirLowerBounds) {
  EXPECT_TRUE(SpeedBins(at::tensor({0.0F, 0.5F, -3.0F, 9.9F, 14.0F, 40.0F}))
                  .equal(at::tensor({0, 1, 2, 3, 4, 5}, at::kLong)));
}

}  // namespace
}  // namespace maneuver::learning::speed_factors_test
