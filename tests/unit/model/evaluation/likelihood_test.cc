#include "model/evaluation/likelihood.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace maneuver::evaluation {
namespace {

inference::ActionDistribution Gaussian(double x, double y, double xx, double xy, double yy) {
  inference::ActionDistribution distribution;
  distribution.moment_mean.resize(1, 2);
  distribution.moment_mean << x, y;
  distribution.moment_covariance.resize(1, 3);
  distribution.moment_covariance << xx, xy, yy;
  return distribution;
}

inference::Trajectory Point(double x, double y) {
  inference::Trajectory trajectory(1, 2);
  trajectory << x, y;
  return trajectory;
}

TEST(MixtureNllTest, OneUnitGaussianAtItsMean) {
  const std::vector distributions = {Gaussian(1.0, 2.0, 1.0, 0.0, 1.0)};
  const std::array weights = {1.0};
  EXPECT_NEAR(MixtureNll(distributions, weights, Point(1.0, 2.0)), std::log(2.0 * std::numbers::pi),
              1e-12);
}

// A density integrates to one: a Riemann sum over a grid that holds all of its mass.
TEST(MixtureNllTest, IsADensity) {
  const std::vector distributions = {Gaussian(0.0, 0.0, 1.0, 0.6, 2.0),
                                     Gaussian(2.0, -1.0, 0.5, -0.2, 0.3)};
  const std::array weights = {0.2, 0.6};  // renormalised to 1/4 and 3/4
  constexpr double kStep = 0.1;
  double integral = 0.0;
  for (double x = -10.0; x < 10.0; x += kStep) {
    for (double y = -10.0; y < 10.0; y += kStep) {
      integral += std::exp(-MixtureNll(distributions, weights, Point(x, y))) * kStep * kStep;
    }
  }
  EXPECT_NEAR(integral, 1.0, 1e-6);
}

TEST(MixtureNllTest, StaysFiniteFarFromEveryAction) {
  const std::vector distributions = {Gaussian(0.0, 0.0, 0.01, 0.0, 0.01)};
  const std::array weights = {1.0};
  EXPECT_NEAR(MixtureNll(distributions, weights, Point(100.0, 0.0)),
              0.5 * 1e6 + std::log(2.0 * std::numbers::pi * 0.01), 1e-6);
}

}  // namespace
}  // namespace maneuver::evaluation
