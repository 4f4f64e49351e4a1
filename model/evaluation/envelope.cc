#include "model/evaluation/envelope.h"

#include <cmath>

#include "model/evaluation/likelihood.h"

namespace maneuver::evaluation {

WaypointCovariances LatentCovariance(const inference::ActionDistribution& distribution) {
  WaypointCovariances covariance = WaypointCovariances::Zero(distribution.moment_mean.rows(), 3);
  for (size_t d = 1; d + 1 < distribution.sigma.size(); d += 2) {
    const inference::Trajectory half = 0.5 * (distribution.sigma[d] - distribution.sigma[d + 1]);
    covariance.col(0).array() += half.col(0).array().square();
    covariance.col(1).array() += half.col(0).array() * half.col(1).array();
    covariance.col(2).array() += half.col(1).array().square();
  }
  return covariance;
}

Coverage CoverageOf(const inference::Trajectory& mean, const WaypointCovariances& covariance,
                    const inference::Trajectory& truth) {
  constexpr double kSingular = 1e-12;  // determinant as a share of the trace's square
  int one = 0;
  int two = 0;
  for (Eigen::Index t = 0; t < truth.rows(); ++t) {
    const double trace = covariance(t, 0) + covariance(t, 2);
    const auto [squared_distance, determinant] = DistanceAt(mean, covariance, truth, t);
    if (!(determinant > kSingular * trace * trace)) continue;
    if (squared_distance <= 1.0) ++one;
    if (squared_distance <= 4.0) ++two;
  }
  const auto count = static_cast<double>(truth.rows());
  return {one / count, two / count};
}

double MeanSigma(const WaypointCovariances& covariance) {
  return (0.5 * (covariance.col(0) + covariance.col(2))).cwiseSqrt().mean();
}

Envelope EnvelopeOf(const inference::ActionDistribution& distribution,
                    const inference::Trajectory& truth) {
  const WaypointCovariances latent = LatentCovariance(distribution);
  return {CoverageOf(distribution.moment_mean, distribution.moment_covariance, truth),
          CoverageOf(distribution.moment_mean, latent, truth), MeanSigma(latent)};
}

}  // namespace maneuver::evaluation
