#include "model/probability/sigma_points.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <random>

#include "tests/unit/model/probability/quadrature.h"

namespace maneuver::probability::sigma_points_test {
namespace {

SigmaMoments MomentsOf(const RowMajorXd& images) {
  SigmaMoments moments;
  MomentsOfSigmaPoints(images, &moments);
  return moments;
}

constexpr int kDimensions = 5;

Eigen::MatrixXd RandomMatrix(Eigen::Index rows, Eigen::Index columns, std::mt19937* random) {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd matrix(rows, columns);
  for (Eigen::Index i = 0; i < matrix.size(); ++i) matrix.data()[i] = normal(*random);
  return matrix;
}

TEST(SigmaPointsTest, AreTheMeanThenPlusAndMinusAlongEachDimension) {
  const Eigen::MatrixXd points = SigmaPoints(Eigen::Vector2d(1, 2), Eigen::Vector2d(0.1, 0.5));
  Eigen::Matrix<double, 5, 2> expected;
  expected << 1, 2, 1.1, 2, 0.9, 2, 1, 2.5, 1, 1.5;
  EXPECT_LT((points - expected).norm(), 1e-15);
}

TEST(SigmaPointsTest, MomentsOfALinearDecoderAreExact) {
  std::mt19937 random(1);
  const Eigen::VectorXd mean = RandomMatrix(kDimensions, 1, &random);
  const Eigen::VectorXd stddev = RandomMatrix(kDimensions, 1, &random).cwiseAbs();
  const Eigen::MatrixXd A = RandomMatrix(8, kDimensions, &random);
  const Eigen::VectorXd b = RandomMatrix(8, 1, &random);
  const Eigen::MatrixXd images =
      (SigmaPoints(mean, stddev) * A.transpose()).rowwise() + b.transpose();
  const SigmaMoments moments = MomentsOf(images);
  const Eigen::VectorXd variance = stddev.array().square();
  EXPECT_LT((moments.mean - (A * mean + b)).norm(), 1e-12);
  EXPECT_LT((moments.Covariance() - A * variance.asDiagonal() * A.transpose()).norm(), 1e-12);

  // The same by sampling.
  const int samples = 50'000;
  std::normal_distribution<double> normal;
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(8);
  Eigen::MatrixXd products = Eigen::MatrixXd::Zero(8, 8);
  for (int i = 0; i < samples; ++i) {
    Eigen::VectorXd z = mean;
    for (int d = 0; d < kDimensions; ++d) z[d] += stddev[d] * normal(random);
    const Eigen::VectorXd x = A * z + b;
    sum += x;
    products += (x - moments.mean) * (x - moments.mean).transpose();
  }
  const double scale = moments.Covariance().diagonal().maxCoeff();
  EXPECT_LT((sum / samples - moments.mean).cwiseAbs().maxCoeff(), 0.02 * std::sqrt(scale));
  EXPECT_LT((products / samples - moments.Covariance()).cwiseAbs().maxCoeff(), 0.03 * scale);
}

TEST(SigmaPointsTest, MeanOfAQuadraticDecoderIsExact) {
  std::mt19937 random(2);
  const Eigen::VectorXd mean = RandomMatrix(kDimensions, 1, &random);
  const Eigen::VectorXd stddev = RandomMatrix(kDimensions, 1, &random).cwiseAbs();
  const Eigen::MatrixXd Q = RandomMatrix(kDimensions, kDimensions, &random);
  const Eigen::MatrixXd points = SigmaPoints(mean, stddev);
  Eigen::MatrixXd images(points.rows(), 1);
  for (Eigen::Index i = 0; i < points.rows(); ++i) {
    images(i, 0) = points.row(i) * Q * points.row(i).transpose();
  }
  // E z^T Q z = m^T Q m + tr(Q Sigma).
  const double expected = mean.dot(Q * mean) + Q.diagonal().dot(stddev.cwiseAbs2());
  EXPECT_NEAR(MomentsOf(images).mean[0], expected, 1e-12);
}

TEST(SigmaPointsTest, CovarianceIsPositiveSemidefiniteForAnyImages) {
  std::mt19937 random(3);
  for (int i = 0; i < 20; ++i) {
    // Without a decoder: the images under a strongly curved one may lie anywhere.
    const SigmaMoments moments = MomentsOf(RandomMatrix(2 * kDimensions + 1, 6, &random));
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(moments.Covariance());
    EXPECT_GT(solver.eigenvalues().minCoeff(), -1e-12);
  }
}

TEST(SigmaPointsTest, MomentsOfAnArcAreCloseToQuadrature) {
  // 20 m driven along an arc whose heading changes by 0.6 rad times z.
  const auto arc = [](double z) {
    const double turn = std::abs(z) < 1e-9 ? 1e-9 : 0.6 * z;
    return Eigen::Vector2d(20 * std::sin(turn) / turn, 20 * (1 - std::cos(turn)) / turn);
  };
  const Eigen::MatrixXd points = SigmaPoints(Eigen::VectorXd::Zero(1), Eigen::VectorXd::Ones(1));
  Eigen::MatrixXd images(3, 2);
  for (Eigen::Index i = 0; i < 3; ++i) images.row(i) = arc(points(i, 0)).transpose();
  const SigmaMoments moments = MomentsOf(images);
  const auto expectation = [&](auto f) {
    return Integrate([&](double z) { return NormalDensity(z, 0, 1) * f(arc(z)); }, -9, 9, 2'001);
  };
  const double mean_x = expectation([](const Eigen::Vector2d& p) { return p.x(); });
  const double variance_y = expectation([](const Eigen::Vector2d& p) { return p.y() * p.y(); });
  EXPECT_NEAR(moments.mean[0], mean_x, 0.05);  // metres
  EXPECT_NEAR(moments.mean[1], 0.0, 1e-9);
  EXPECT_NEAR(std::sqrt(moments.Covariance()(1, 1)), std::sqrt(variance_y),
              0.1 * std::sqrt(variance_y));
}

TEST(SigmaPointsTest, ExpectedLogDensityMatchesQuadrature) {
  const double slope = 1.7, offset = 0.3, mean = 0.5, deviation = 0.4, stddev = 0.8, x = 2.0;
  const Eigen::MatrixXd points =
      SigmaPoints(Eigen::VectorXd::Constant(1, mean), Eigen::VectorXd::Constant(1, deviation));
  const SigmaMoments moments = MomentsOf((slope * points).array() + offset);
  const double expected = Integrate(
      [&](double z) {
        return NormalDensity(z, mean, deviation * deviation) *
               std::log(NormalDensity(x, slope * z + offset, stddev * stddev));
      },
      mean - 8, mean + 8, 20'000);
  EXPECT_NEAR(ExpectedLogDensity(Eigen::VectorXd::Constant(1, x), moments, stddev), expected, 1e-8);
}

}  // namespace
}  // namespace maneuver::probability::sigma_points_test
