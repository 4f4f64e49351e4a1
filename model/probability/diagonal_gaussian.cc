#include "model/probability/diagonal_gaussian.h"

#include <cmath>
#include <numbers>

namespace maneuver::probability {
namespace {

const double kLogTwoPi = std::log(2.0 * std::numbers::pi);

}  // namespace

double Entropy(const DiagonalGaussian& q) {
  return 0.5 * (kLogTwoPi + 1.0 + q.log_variance.array()).sum();
}

double CrossEntropy(const DiagonalGaussian& q, const DiagonalGaussian& p) {
  const auto squared_error = (q.mean - p.mean).array().square();
  return 0.5 *
         (kLogTwoPi + p.log_variance.array() + (q.log_variance - p.log_variance).array().exp() +
          squared_error * (-p.log_variance.array()).exp())
             .sum();
}

double KlDivergence(const DiagonalGaussian& q, const DiagonalGaussian& p) {
  const auto squared_error = (q.mean - p.mean).array().square();
  const auto log_ratio = (q.log_variance - p.log_variance).array();
  // With expm1, the divergence of two nearly equal Gaussians is accurate and never negative.
  return 0.5 * (log_ratio.unaryExpr([](double r) { return std::expm1(r) - r; }) +
                squared_error * (-p.log_variance.array()).exp())
                   .sum();
}

}  // namespace maneuver::probability
