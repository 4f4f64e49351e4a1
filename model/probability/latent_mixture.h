// The actions as a mixture of Gaussians in latent space: p(z|y), and p(y) without a scenario.

#ifndef MANEUVER_MODEL_PROBABILITY_LATENT_MIXTURE_H_
#define MANEUVER_MODEL_PROBABILITY_LATENT_MIXTURE_H_

#include <Eigen/Core>

#include "model/probability/diagonal_gaussian.h"

namespace maneuver::probability {

// Returns ln sum exp(values) without overflow or underflow; -infinity only if all values are.
double LogSumExp(const Eigen::VectorXd& values);

// Returns values - LogSumExp(values): turns logits into log probabilities.
Eigen::VectorXd LogSoftmax(const Eigen::VectorXd& values);

// Returns exp(values) / sum exp(values) without overflow. The result sums to 1 within 1e-15 K.
Eigen::VectorXd Softmax(const Eigen::VectorXd& values);

struct LatentMixture {
  Eigen::MatrixXd mean;          // [K, D]
  Eigen::MatrixXd log_variance;  // [K, D]
  Eigen::VectorXd log_weight;    // [K] ln p(y), normalised

  int components() const { return static_cast<int>(mean.rows()); }
  int dimensions() const { return static_cast<int>(mean.cols()); }

  // Returns p(z|y=k).
  DiagonalGaussian Component(int k) const { return {mean.row(k), log_variance.row(k)}; }
};

}  // namespace maneuver::probability

#endif  // MANEUVER_MODEL_PROBABILITY_LATENT_MIXTURE_H_
