#include "model/probability/latent_mixture.h"

#include <cmath>

namespace maneuver::probability {

double LogSumExp(const Eigen::VectorXd& values) {
  const double largest = values.maxCoeff();
  if (!std::isfinite(largest)) return largest;
  return largest + std::log((values.array() - largest).exp().sum());
}

Eigen::VectorXd LogSoftmax(const Eigen::VectorXd& values) {
  return values.array() - LogSumExp(values);
}

Eigen::VectorXd Softmax(const Eigen::VectorXd& values) {
  const Eigen::VectorXd shares = (values.array() - values.maxCoeff()).exp();
  return shares / shares.sum();
}

}  // namespace maneuver::probability
