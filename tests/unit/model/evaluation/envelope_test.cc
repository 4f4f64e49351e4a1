#include "model/evaluation/envelope.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace maneuver::evaluation::envelope_test {
namespace {

using inference::Trajectory;

Trajectory Points(std::initializer_list<std::array<double, 2>> points) {
  Trajectory trajectory(points.size(), 2);
  int t = 0;
  for (const auto& [x, y] : points) trajectory.row(t++) << x, y;
  return trajectory;
}

WaypointCovariances Covariances(std::initializer_list<std::array<double, 3>> rows) {
  WaypointCovariances covariance(rows.size(), 3);
  int t = 0;
  for (const auto& [xx, xy, yy] : rows) covariance.row(t++) << xx, xy, yy;
  return covariance;
}

// Deviations of 3 m along x and 1 m along y: 3 m ahead is one sigma, 2 m to the side is two.
TEST(EnvelopeTest, MeasuresEllipsesAlongTheirAxes) {
  const Trajectory mean = Points({{0, 0}, {0, 0}, {0, 0}, {0, 0}});
  const WaypointCovariances covariance = Covariances({{9, 0, 1}, {9, 0, 1}, {9, 0, 1}, {9, 0, 1}});
  const Coverage coverage =
      CoverageOf(mean, covariance, Points({{3.0, 0.0}, {0.0, 1.01}, {0.0, 2.0}, {0.0, 2.01}}));
  EXPECT_DOUBLE_EQ(coverage.one_sigma, 0.25);
  EXPECT_DOUBLE_EQ(coverage.two_sigma, 0.75);
}

// The ellipse of [2 1; 1 2] is long along (1, 1), where its deviation is sqrt 3, and short across
// it.
TEST(EnvelopeTest, EllipsesTurnWithTheirCovariance) {
  const Trajectory mean = Points({{5, 5}, {5, 5}});
  const WaypointCovariances covariance = Covariances({{2, 1, 2}, {2, 1, 2}});
  const double along = std::sqrt(3.0 / 2.0);
  const Coverage coverage = CoverageOf(
      mean, covariance,
      Points({{5.0 + 0.99 * along, 5.0 + 0.99 * along}, {5.0 + 0.99 * along, 5.0 - 0.99 * along}}));
  EXPECT_DOUBLE_EQ(coverage.one_sigma, 0.5);
  EXPECT_DOUBLE_EQ(coverage.two_sigma, 1.0);
}

TEST(EnvelopeTest, GaussiansContainTheTheoreticalShare) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  constexpr int kCount = 40'000;
  Trajectory truth(kCount, 2);
  WaypointCovariances covariance(kCount, 3);
  for (int i = 0; i < kCount; ++i) {
    const double a = normal(random);
    const double b = normal(random);
    truth.row(i) << 2.0 * a, a + 0.5 * b;  // covariance [4 2; 2 1.25]
    covariance.row(i) << 4.0, 2.0, 1.25;
  }
  const Coverage coverage = CoverageOf(Trajectory::Zero(kCount, 2), covariance, truth);
  EXPECT_NEAR(coverage.one_sigma, kGaussianOneSigma, 0.01);
  EXPECT_NEAR(coverage.two_sigma, kGaussianTwoSigma, 0.01);
}

TEST(EnvelopeTest, ASingularCovarianceContainsNothing) {
  const Coverage coverage = CoverageOf(
      Points({{0, 0}, {0, 0}}), Covariances({{4, 0, 0}, {0, 0, 0}}), Points({{1, 0}, {0, 0}}));
  EXPECT_DOUBLE_EQ(coverage.two_sigma, 0.0);
}

// f(z) = (2 z_1 + z_2, 3 z_2) at sigma points of unit latents: A A^T = [5 3; 3 9].
TEST(EnvelopeTest, LatentCovarianceIsExactForALinearDecoder) {
  inference::ActionDistribution distribution;
  distribution.sigma = {Points({{1, 1}}), Points({{3, 1}}), Points({{-1, 1}}), Points({{2, 4}}),
                        Points({{0, -2}})};
  distribution.moment_mean = Points({{1, 1}});
  distribution.moment_covariance = Covariances({{105, 3, 109}});
  EXPECT_EQ(LatentCovariance(distribution), Covariances({{5, 3, 9}}));

  const Envelope envelope = EnvelopeOf(distribution, Points({{11, 1}}));  // 10 m off along x
  EXPECT_DOUBLE_EQ(envelope.whole.one_sigma, 1.0);
  EXPECT_DOUBLE_EQ(envelope.latent.two_sigma, 0.0);
  EXPECT_DOUBLE_EQ(envelope.mean_sigma, std::sqrt(7.0));
}

TEST(EnvelopeTest, MeanSigmaAveragesDeviationsAndNotVariances) {
  EXPECT_DOUBLE_EQ(MeanSigma(Covariances({{1, 0, 1}, {9, 0, 9}})), 2.0);
}

}  // namespace
}  // namespace maneuver::evaluation::envelope_test
