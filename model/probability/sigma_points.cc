#include "model/probability/sigma_points.h"

#include <cmath>
#include <numbers>

namespace maneuver::probability {

RowMajorXd SigmaPoints(const Eigen::VectorXd& mean, const Eigen::VectorXd& stddev) {
  const Eigen::Index dimensions = mean.size();
  RowMajorXd points = mean.transpose().replicate(2 * dimensions + 1, 1);
  for (Eigen::Index d = 0; d < dimensions; ++d) {
    points(1 + 2 * d, d) += stddev[d];
    points(2 + 2 * d, d) -= stddev[d];
  }
  return points;
}

void MomentsOfSigmaPoints(const RowMajorXd& images, SigmaMoments* moments) {
  const Eigen::Index dimensions = (images.rows() - 1) / 2;
  moments->mean = images.row(0);
  moments->deviations.resize(dimensions, images.cols());
  for (Eigen::Index d = 0; d < dimensions; ++d) {
    const auto plus = images.row(1 + 2 * d);
    const auto minus = images.row(2 + 2 * d);
    moments->mean += 0.5 * (plus - 2.0 * images.row(0) + minus);
    moments->deviations.row(d) = 0.5 * (plus - minus);
  }
}

double ExpectedLogDensity(const Eigen::VectorXd& x, const SigmaMoments& moments, double stddev) {
  const double variance = stddev * stddev;
  const double squared_error = (x - moments.mean).squaredNorm() + moments.deviations.squaredNorm();
  return -0.5 * (static_cast<double>(x.size()) * std::log(2.0 * std::numbers::pi * variance) +
                 squared_error / variance);
}

}  // namespace maneuver::probability
