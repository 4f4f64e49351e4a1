// The responsibilities q(y|x,s): which action a trajectory belongs to. A closed form, never a
// network.

#ifndef MANEUVER_MODEL_PROBABILITY_RESPONSIBILITIES_H_
#define MANEUVER_MODEL_PROBABILITY_RESPONSIBILITIES_H_

#include <Eigen/Core>
#include <span>

#include "model/probability/diagonal_gaussian.h"
#include "model/probability/latent_mixture.h"

namespace maneuver::probability {

// Returns ln p(y|s) - H(q(z|x), p(z|y)) for each y, [K]: the logarithm of the numerator of eq.
// (qy).
//   log_prior: ln p(y|s), [K].
//   encoding: q(z|x).
Eigen::VectorXd BaseEvidence(const Eigen::VectorXd& log_prior, const DiagonalGaussian& encoding,
                             const LatentMixture& mixture);

// Returns the base model's q(y|x,s), eq. (qy): p(y|s) exp(-H(q_z, p_z)), normalised over y. [K]
Eigen::VectorXd BaseResponsibilities(const Eigen::VectorXd& log_prior,
                                     const DiagonalGaussian& encoding,
                                     const LatentMixture& mixture);

// Returns the unified model's q(y|x,s), eq. (qy_unified): p(y|s) exp(-H(q_z, p_z) - KL(q_z' ||
// p_z')), normalised over y. [K]
//   posteriors: q(z'|y,s) for each y, [K].
Eigen::VectorXd UnifiedResponsibilities(const Eigen::VectorXd& log_prior,
                                        const DiagonalGaussian& encoding,
                                        const LatentMixture& mixture,
                                        std::span<const DiagonalGaussian> posteriors);

// Returns the evidence lower bound on ln p(x|s) of the base model, eq. (elbo), maximised over
// q(y|x,s). The maximum is at eq. (qy), where
//   -KL(q_y || p_y) - sum_y q_y KL(q_z || p_z) = H(q_z) + ln sum_y p_y exp(-H(q_z, p_z)).
// The bound is that plus the expected reconstruction E_q(z|x) ln p(x|z).
double BaseBound(double expected_reconstruction, const Eigen::VectorXd& log_prior,
                 const DiagonalGaussian& encoding, const LatentMixture& mixture);

}  // namespace maneuver::probability

#endif  // MANEUVER_MODEL_PROBABILITY_RESPONSIBILITIES_H_
