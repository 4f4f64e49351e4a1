#include "model/probability/responsibilities.h"

namespace maneuver::probability {

Eigen::VectorXd BaseEvidence(const Eigen::VectorXd& log_prior, const DiagonalGaussian& encoding,
                             const LatentMixture& mixture) {
  Eigen::VectorXd evidence = log_prior;
  for (int k = 0; k < mixture.components(); ++k) {
    evidence[k] -= CrossEntropy(encoding, mixture.Component(k));
  }
  return evidence;
}

Eigen::VectorXd BaseResponsibilities(const Eigen::VectorXd& log_prior,
                                     const DiagonalGaussian& encoding,
                                     const LatentMixture& mixture) {
  return Softmax(BaseEvidence(log_prior, encoding, mixture));
}

Eigen::VectorXd UnifiedResponsibilities(const Eigen::VectorXd& log_prior,
                                        const DiagonalGaussian& encoding,
                                        const LatentMixture& mixture,
                                        std::span<const DiagonalGaussian> posteriors) {
  Eigen::VectorXd evidence = BaseEvidence(log_prior, encoding, mixture);
  for (int k = 0; k < mixture.components(); ++k) {
    evidence[k] -= KlDivergence(posteriors[static_cast<size_t>(k)], mixture.Component(k));
  }
  return Softmax(evidence);
}

double BaseBound(double expected_reconstruction, const Eigen::VectorXd& log_prior,
                 const DiagonalGaussian& encoding, const LatentMixture& mixture) {
  return expected_reconstruction + Entropy(encoding) +
         LogSumExp(BaseEvidence(log_prior, encoding, mixture));
}

}  // namespace maneuver::probability
