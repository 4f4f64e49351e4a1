#include "model/probability/diagonal_gaussian.h"

#include <gtest/gtest.h>

#include <cmath>

#include "model/probability/latent_mixture.h"
#include "tests/unit/model/probability/quadrature.h"

namespace maneuver::probability::diagonal_gaussian_test {
namespace {

constexpr double kReach = 40.0;
constexpr int kSteps = 40'000;

DiagonalGaussian OneDimensional(double mean, double variance) {
  return {Eigen::VectorXd::Constant(1, mean), Eigen::VectorXd::Constant(1, std::log(variance))};
}

// Pairs that are near, far, narrow within wide, and wide around narrow.
struct Pair {
  double q_mean, q_variance, p_mean, p_variance;
};
constexpr Pair kPairs[] = {
    {0, 1, 0, 1}, {0.3, 0.5, -0.7, 2.0}, {1.5, 0.04, 1.0, 4.0}, {-1, 3, 2, 0.5}};

TEST(DiagonalGaussianTest, CrossEntropyMatchesItsIntegral) {
  for (const Pair& pair : kPairs) {
    const double integral = Integrate(
        [&](double z) {
          const double log_p = -(z - pair.p_mean) * (z - pair.p_mean) / (2 * pair.p_variance) -
                               0.5 * std::log(2 * std::numbers::pi * pair.p_variance);
          return -NormalDensity(z, pair.q_mean, pair.q_variance) * log_p;
        },
        -kReach, kReach, kSteps);
    EXPECT_NEAR(CrossEntropy(OneDimensional(pair.q_mean, pair.q_variance),
                             OneDimensional(pair.p_mean, pair.p_variance)),
                integral, 1e-8);
  }
}

TEST(DiagonalGaussianTest, KlDivergenceMatchesItsIntegral) {
  for (const Pair& pair : kPairs) {
    const double integral = Integrate(
        [&](double z) {
          const double q = NormalDensity(z, pair.q_mean, pair.q_variance);
          if (q == 0) return 0.0;
          const double log_ratio = (z - pair.p_mean) * (z - pair.p_mean) / (2 * pair.p_variance) -
                                   (z - pair.q_mean) * (z - pair.q_mean) / (2 * pair.q_variance) +
                                   0.5 * std::log(pair.p_variance / pair.q_variance);
          return q * log_ratio;
        },
        -kReach, kReach, kSteps);
    EXPECT_NEAR(KlDivergence(OneDimensional(pair.q_mean, pair.q_variance),
                             OneDimensional(pair.p_mean, pair.p_variance)),
                integral, 1e-8);
  }
}

TEST(DiagonalGaussianTest, EntropyMatchesItsIntegral) {
  const double mean = 0.4, variance = 0.7;
  const DiagonalGaussian q = OneDimensional(mean, variance);
  const auto density = [&](double z) { return NormalDensity(z, mean, variance); };
  EXPECT_NEAR(Entropy(q),
              Integrate(
                  [&](double z) {
                    const double d = density(z);
                    return d > 0 ? -d * std::log(d) : 0.0;
                  },
                  -kReach, kReach, kSteps),
              1e-8);
}

TEST(DiagonalGaussianTest, DimensionsAddUp) {
  const Eigen::Vector3d q_mean(0.1, -2, 1), q_log_variance(0.5, -1, 0.2);
  const Eigen::Vector3d p_mean(0.3, 1, 0), p_log_variance(-0.5, 1, 0);
  const DiagonalGaussian q{q_mean, q_log_variance}, p{p_mean, p_log_variance};
  double cross_entropy = 0, divergence = 0, entropy = 0;
  for (int d = 0; d < 3; ++d) {
    const DiagonalGaussian q_d = OneDimensional(q_mean[d], std::exp(q_log_variance[d]));
    const DiagonalGaussian p_d = OneDimensional(p_mean[d], std::exp(p_log_variance[d]));
    cross_entropy += CrossEntropy(q_d, p_d);
    divergence += KlDivergence(q_d, p_d);
    entropy += Entropy(q_d);
  }
  EXPECT_NEAR(CrossEntropy(q, p), cross_entropy, 1e-12);
  EXPECT_NEAR(KlDivergence(q, p), divergence, 1e-12);
  EXPECT_NEAR(Entropy(q), entropy, 1e-12);
}

TEST(DiagonalGaussianTest, KlDivergenceIsCrossEntropyMinusEntropyAndNeverNegative) {
  for (const Pair& pair : kPairs) {
    const DiagonalGaussian q = OneDimensional(pair.q_mean, pair.q_variance);
    const DiagonalGaussian p = OneDimensional(pair.p_mean, pair.p_variance);
    EXPECT_NEAR(KlDivergence(q, p), CrossEntropy(q, p) - Entropy(q), 1e-12);
    EXPECT_EQ(KlDivergence(q, q), 0.0);
  }
  // Nearly equal variances: half the squared difference of their logarithms, over 2.
  const double difference = 1e-7;
  const DiagonalGaussian p = OneDimensional(0, 1);
  const DiagonalGaussian q{p.mean, p.log_variance.array() + difference};
  EXPECT_GE(KlDivergence(q, p), 0.0);
  EXPECT_NEAR(KlDivergence(q, p), difference * difference / 4, 1e-16);
}

TEST(LatentMixtureTest, SoftmaxNeitherOverflowsNorUnderflows) {
  const Eigen::Vector3d logits(1000, 999, -1e5);
  const Eigen::VectorXd shares = Softmax(logits);
  EXPECT_NEAR(shares[0], 1 / (1 + std::exp(-1.0)), 1e-12);
  EXPECT_NEAR(shares.sum(), 1.0, 1e-15);
  EXPECT_NEAR(LogSumExp(logits), 1000 + std::log1p(std::exp(-1.0)), 1e-9);
  EXPECT_NEAR(LogSoftmax(logits)[2], -1e5 - LogSumExp(logits), 1e-6);
  EXPECT_NEAR(LogSumExp(Eigen::Vector2d(-1e5, -1e5)), -1e5 + std::log(2.0), 1e-9);
}

}  // namespace
}  // namespace maneuver::probability::diagonal_gaussian_test
