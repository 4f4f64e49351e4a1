#include "model/evaluation/likelihood.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace maneuver::evaluation {
namespace {

// ln N((dx, dy); 0, [xx xy; xy yy]).
double LogGaussian(double dx, double dy, double xx, double xy, double yy) {
  const double determinant = xx * yy - xy * xy;
  const double mahalanobis = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / determinant;
  return -0.5 * mahalanobis - 0.5 * std::log(determinant) - std::log(2.0 * std::numbers::pi);
}

double LogSumExp(std::span<const double> terms) {
  const double largest = *std::max_element(terms.begin(), terms.end());
  if (!std::isfinite(largest)) return largest;
  double sum = 0.0;
  for (const double term : terms) sum += std::exp(term - largest);
  return largest + std::log(sum);
}

}  // namespace

double MixtureNll(std::span<const inference::ActionDistribution> distributions,
                  std::span<const double> probabilities, const inference::Trajectory& truth) {
  double total = 0.0;
  for (const double p : probabilities) total += p;
  std::vector<double> terms(distributions.size());
  double nll = 0.0;
  for (Eigen::Index t = 0; t < truth.rows(); ++t) {
    for (size_t k = 0; k < distributions.size(); ++k) {
      const auto& covariance = distributions[k].moment_covariance;
      const double dx = truth(t, 0) - distributions[k].moment_mean(t, 0);
      const double dy = truth(t, 1) - distributions[k].moment_mean(t, 1);
      terms[k] = std::log(probabilities[k] / total) +
                 LogGaussian(dx, dy, covariance(t, 0), covariance(t, 1), covariance(t, 2));
    }
    nll -= LogSumExp(terms);
  }
  return nll / static_cast<double>(truth.rows());
}

}  // namespace maneuver::evaluation
