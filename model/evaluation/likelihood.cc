#include "model/evaluation/likelihood.h"

#include <cmath>
#include <numbers>

#include "model/probability/latent_mixture.h"

namespace maneuver::evaluation {
namespace {

// Returns ln N(x_t; m_t, C_t).
double LogDensity(const inference::ActionDistribution& distribution,
                  const inference::Trajectory& truth, Eigen::Index t) {
  const auto [squared_distance, determinant] =
      DistanceAt(distribution.moment_mean, distribution.moment_covariance, truth, t);
  return -0.5 * squared_distance - 0.5 * std::log(determinant) - std::log(2.0 * std::numbers::pi);
}

}  // namespace

WaypointDistance DistanceAt(const inference::Trajectory& mean,
                            const inference::WaypointCovariances& covariance,
                            const inference::Trajectory& truth, Eigen::Index t) {
  const double dx = truth(t, 0) - mean(t, 0);
  const double dy = truth(t, 1) - mean(t, 1);
  const double xx = covariance(t, 0);
  const double xy = covariance(t, 1);
  const double yy = covariance(t, 2);
  const double determinant = xx * yy - xy * xy;
  return {(yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / determinant, determinant};
}

double GaussianNll(const inference::ActionDistribution& distribution,
                   const inference::Trajectory& truth) {
  double nll = 0.0;
  for (Eigen::Index t = 0; t < truth.rows(); ++t) nll -= LogDensity(distribution, truth, t);
  return nll / static_cast<double>(truth.rows());
}

MixtureNll MixtureNllOf(std::span<const inference::ActionDistribution> distributions,
                        std::span<const double> probabilities, const inference::Trajectory& truth) {
  const Eigen::VectorXd log_weights =
      Eigen::Map<const Eigen::ArrayXd>(probabilities.data(),
                                       static_cast<Eigen::Index>(probabilities.size()))
          .log();
  const double log_total = probability::LogSumExp(log_weights);
  Eigen::VectorXd joint = log_weights;
  Eigen::VectorXd at_waypoint(log_weights.size());
  MixtureNll nll;
  for (Eigen::Index t = 0; t < truth.rows(); ++t) {
    for (Eigen::Index y = 0; y < log_weights.size(); ++y) {
      const double log_density = LogDensity(distributions[static_cast<size_t>(y)], truth, t);
      at_waypoint[y] = log_weights[y] + log_density;
      joint[y] += log_density;
    }
    nll.marginal -= probability::LogSumExp(at_waypoint) - log_total;
  }
  nll.marginal /= static_cast<double>(truth.rows());
  nll.joint = log_total - probability::LogSumExp(joint);
  return nll;
}

}  // namespace maneuver::evaluation
