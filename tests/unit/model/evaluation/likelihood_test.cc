#include "model/evaluation/likelihood.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace maneuver::evaluation::likelihood_test {
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

TEST(LikelihoodTest, HasTheDensityOfAUnitGaussianAtItsMean) {
  const std::vector distributions = {Gaussian(1.0, 2.0, 1.0, 0.0, 1.0)};
  const std::array weights = {1.0};
  EXPECT_NEAR(MixtureNllOf(distributions, weights, Point(1.0, 2.0)).marginal,
              std::log(2.0 * std::numbers::pi), 1e-12);
}

// A density integrates to one: Riemann sum over a grid that covers all of its mass.
TEST(LikelihoodTest, IntegratesToOne) {
  const std::vector distributions = {Gaussian(0.0, 0.0, 1.0, 0.6, 2.0),
                                     Gaussian(2.0, -1.0, 0.5, -0.2, 0.3)};
  const std::array weights = {0.2, 0.6};  // renormalised to 1/4 and 3/4
  constexpr double kStep = 0.1;
  double integral = 0.0;
  for (double x = -10.0; x < 10.0; x += kStep) {
    for (double y = -10.0; y < 10.0; y += kStep) {
      integral +=
          std::exp(-MixtureNllOf(distributions, weights, Point(x, y)).marginal) * kStep * kStep;
    }
  }
  EXPECT_NEAR(integral, 1.0, 1e-6);
}

TEST(LikelihoodTest, StaysFiniteFarFromEveryAction) {
  const std::vector distributions = {Gaussian(0.0, 0.0, 0.01, 0.0, 0.01)};
  const std::array weights = {1.0};
  EXPECT_NEAR(MixtureNllOf(distributions, weights, Point(100.0, 0.0)).marginal,
              0.5 * 1e6 + std::log(2.0 * std::numbers::pi * 0.01), 1e-6);
}

// Two waypoints, two actions a metre to either side, unit covariance: computed by hand.
TEST(LikelihoodTest, JointUsesOneActionPerTrajectoryAndMarginalOnePerWaypoint) {
  const auto row = [](double first, double second) {
    inference::ActionDistribution distribution;
    distribution.moment_mean.resize(2, 2);
    distribution.moment_mean << first, 0.0, second, 0.0;
    distribution.moment_covariance.resize(2, 3);
    distribution.moment_covariance << 1.0, 0.0, 1.0, 1.0, 0.0, 1.0;
    return distribution;
  };
  const std::vector distributions = {row(-1.0, -1.0), row(1.0, 1.0)};
  const std::array weights = {0.5, 1.5};  // renormalised to 1/4 and 3/4
  inference::Trajectory truth(2, 2);
  truth << -1.0, 0.0, 1.0, 0.0;  // begins like one action and ends like the other
  const double at = 1.0 / (2.0 * std::numbers::pi);
  const double off = at * std::exp(-2.0);
  const MixtureNll nll = MixtureNllOf(distributions, weights, truth);
  EXPECT_NEAR(nll.joint, -std::log(0.25 * at * off + 0.75 * off * at), 1e-12);
  EXPECT_NEAR(nll.marginal,
              -0.5 * (std::log(0.25 * at + 0.75 * off) + std::log(0.25 * off + 0.75 * at)), 1e-12);
}

TEST(LikelihoodTest, AnActionOfProbabilityZeroAddsNothing) {
  const std::vector distributions = {Gaussian(0.0, 0.0, 1.0, 0.0, 1.0),
                                     Gaussian(5.0, 0.0, 1.0, 0.0, 1.0)};
  const std::array weights = {1.0, 0.0};
  const MixtureNll nll = MixtureNllOf(distributions, weights, Point(1.0, 0.0));
  const double alone = GaussianNll(distributions[0], Point(1.0, 0.0));
  EXPECT_NEAR(nll.marginal, alone, 1e-12);
  EXPECT_NEAR(nll.joint, alone, 1e-12);
}

// ln det [2 1; 1 1] = 0, and (1, 1) [1 -1; -1 2] (1, 1)^T = 1.
TEST(LikelihoodTest, ASingleActionHasItsGaussiansLikelihood) {
  EXPECT_NEAR(GaussianNll(Gaussian(0.0, 0.0, 2.0, 1.0, 1.0), Point(1.0, 1.0)),
              0.5 + std::log(2.0 * std::numbers::pi), 1e-12);
}

}  // namespace
}  // namespace maneuver::evaluation::likelihood_test
