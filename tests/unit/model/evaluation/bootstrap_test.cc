#include "model/evaluation/bootstrap.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace maneuver::evaluation::bootstrap_test {
namespace {

TEST(BootstrapTest, EachDrawHasAsManyGroupsAsThereAre) {
  const Eigen::MatrixXd draws = DrawGroups(40, 500, 3);
  ASSERT_EQ(draws.rows(), 500);
  ASSERT_EQ(draws.cols(), 40);
  EXPECT_TRUE((draws.rowwise().sum().array() == 40.0).all());
  // Each count is binomial with 40 trials of 1/40: mean 1, variance 39/40.
  EXPECT_NEAR(draws.mean(), 1.0, 1e-12);
  EXPECT_NEAR((draws.array() - 1.0).square().mean(), 0.975, 0.03);
}

TEST(BootstrapTest, OnlyTheSameSeedDrawsTheSameGroups) {
  EXPECT_EQ(DrawGroups(10, 20, 3), DrawGroups(10, 20, 3));
  EXPECT_NE(DrawGroups(10, 20, 3), DrawGroups(10, 20, 4));
}

TEST(BootstrapTest, PercentilesAreInterpolatedAndIgnoreValuesThatAreNotFinite) {
  std::vector<double> values = {NAN, HUGE_VAL};
  for (int i = 40; i >= 0; --i) values.push_back(i);
  const Interval interval = PercentileInterval(values);
  EXPECT_DOUBLE_EQ(interval.lower, 1.0);
  EXPECT_DOUBLE_EQ(interval.upper, 39.0);
  EXPECT_TRUE(std::isnan(PercentileInterval({NAN}).lower));
}

// By the central limit theorem, the mean of n independent groups with standard deviation s lies
// within 1.96 s / sqrt(n) of the truth in 95 % of cases.
TEST(BootstrapTest, TheIntervalOfAMeanMatchesNormalTheory) {
  constexpr int kGroups = 400;
  std::mt19937_64 random(5);
  std::exponential_distribution<double> exponential(0.5);
  Eigen::VectorXd values(kGroups);
  for (double& value : values) value = exponential(random);
  const Eigen::VectorXd means = DrawGroups(kGroups, 4000, 1) * values / kGroups;
  const Interval interval = PercentileInterval({means.begin(), means.end()});
  const double mean = values.mean();
  const double half = 1.96 * std::sqrt((values.array() - mean).square().mean() / kGroups);
  EXPECT_NEAR(interval.lower, mean - half, 0.08 * half);
  EXPECT_NEAR(interval.upper, mean + half, 0.08 * half);
}

// Of a mean, the jackknife is the textbook's standard error: s / sqrt(n).
TEST(JackknifeTest, TheErrorOfAMeanIsExact) {
  const std::vector<double> values = {3.0, -1.0, 4.0, 1.5, 9.0};
  const double sum = 16.5;
  std::vector<double> without;
  double squares = 0.0;
  for (const double value : values) {
    without.push_back((sum - value) / 4.0);
    squares += std::pow(value - sum / 5.0, 2);
  }
  EXPECT_NEAR(JackknifeError(without), std::sqrt(squares / 4.0 / 5.0), 1e-12);
  EXPECT_EQ(JackknifeError(std::vector<double>(3, 0.5)), 0.0);
}

// Of the logarithm of a mean, the delta method gives s / (sqrt(n) mean).
TEST(JackknifeTest, TheErrorOfACurvedFigureMatchesTheDeltaMethod) {
  constexpr int kGroups = 400;
  std::mt19937_64 random(7);
  std::exponential_distribution<double> exponential(0.5);
  Eigen::VectorXd values(kGroups);
  for (double& value : values) value = exponential(random);
  std::vector<double> without;
  for (const double value : values) {
    without.push_back(std::log((values.sum() - value) / (kGroups - 1)));
  }
  const double mean = values.mean();
  const double error = std::sqrt((values.array() - mean).square().mean() / kGroups) / mean;
  EXPECT_NEAR(JackknifeError(without), error, 0.01 * error);
}

}  // namespace
}  // namespace maneuver::evaluation::bootstrap_test
