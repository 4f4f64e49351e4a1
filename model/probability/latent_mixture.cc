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

double LogDensity(const LatentMixture& mixture, const Eigen::VectorXd& z) {
  Eigen::VectorXd log_joint = mixture.log_weight;
  for (int k = 0; k < mixture.components(); ++k)
    log_joint[k] += LogDensity(mixture.Component(k), z);
  return LogSumExp(log_joint);
}

}  // namespace maneuver::probability
