// How wide answers are: fitted after learning to what examples do under the actions that they are.

#ifndef MANEUVER_MODEL_LEARNING_COVARIANCE_FIT_H_
#define MANEUVER_MODEL_LEARNING_COVARIANCE_FIT_H_

#include "model/learning/predictions.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// The covariance that p(x|z) adds to each action and waypoint, [K, T, 3]: first the residuals
// around the mean trajectory, weighted by q(y|x,s), less what the latent covariance already
// explains; from there up the likelihood of the mixture (what an evaluation calls its NLL).
at::Tensor FitDecoderCovariance(const Predictions& predictions, at::Generator& generator);

// Those residuals for all actions together, [T, 3].
at::Tensor PooledCovariance(const Predictions& predictions);

// What makes held-out trajectories most likely under the actions that they are (of the few
// largest q(y|x,s)): residuals on examples that were learned from are too small, and each action
// has to hold its own (under p(y|s), neighbours would cover for one that is too narrow).
struct CovarianceScale {
  at::Tensor factor;           // of the decoder's covariance at each waypoint, exp(a + b t), [T]
  double latent_stddev = 1.0;  // factor of the standard deviations of q(z|y,s), in [1/3, 3]
};

//   covariance: the decoder's, [K, T, 3], or one for each example, [N, K, T, 3]
//   fit_latent: whether the latent's is fitted too, else it stays 1
CovarianceScale FitCovarianceScale(const Predictions& held_out, const at::Tensor& covariance,
                                   bool fit_latent);

// Share of the waypoints that lie in the 2-sigma ellipse of the actions that they are, as an
// evaluation counts it; a Gaussian holds 1 - exp(-2).
//   covariance: the decoder's, as above
double CoveredShare(const Predictions& predictions, const at::Tensor& covariance);

// The least factor, at least 1 and at most 16, by which the decoder's covariance has to be
// multiplied for CoveredShare to be at least `share`.
double WidenToCover(const Predictions& held_out, const at::Tensor& covariance, double share);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_COVARIANCE_FIT_H_
