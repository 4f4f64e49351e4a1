// Gaussians with independent dimensions. All quantities in nats.

#ifndef MANEUVER_MODEL_PROBABILITY_DIAGONAL_GAUSSIAN_H_
#define MANEUVER_MODEL_PROBABILITY_DIAGONAL_GAUSSIAN_H_

#include <Eigen/Core>

namespace maneuver::probability {

// N(mean, diag(exp(log_variance))).
struct DiagonalGaussian {
  Eigen::VectorXd mean;          // [D]
  Eigen::VectorXd log_variance;  // [D]

  Eigen::VectorXd stddev() const { return (0.5 * log_variance.array()).exp(); }
};

// Returns H(q) = -E_q ln q(z).
double Entropy(const DiagonalGaussian& q);

// Returns H(q, p) = -E_q ln p(z), the cross entropy of eq. (qy).
double CrossEntropy(const DiagonalGaussian& q, const DiagonalGaussian& p);

// Returns KL(q || p) = E_q ln (q(z) / p(z)).
double KlDivergence(const DiagonalGaussian& q, const DiagonalGaussian& p);

}  // namespace maneuver::probability

#endif  // MANEUVER_MODEL_PROBABILITY_DIAGONAL_GAUSSIAN_H_
