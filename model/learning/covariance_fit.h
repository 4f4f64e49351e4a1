// Fits the covariance of answers after learning. An example is compared with the action that it
// belongs to by q(y|x,s). Covariances are [.., 3]: xx, xy, yy, square metres.

#ifndef MANEUVER_MODEL_LEARNING_COVARIANCE_FIT_H_
#define MANEUVER_MODEL_LEARNING_COVARIANCE_FIT_H_

#include <cstdint>

#include "model/learning/calibration_steps.h"
#include "model/learning/predictions.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Returns the covariance that p(x|z) adds to each action and waypoint, [K, T, 3]. It starts from
// the residuals around the mean trajectory, weighted by q(y|x,s), minus the part that the latent
// covariance already explains. From there it maximises the likelihood of the mixture (an
// evaluation's NLL).
at::Tensor FitDecoderCovariance(const Predictions& predictions, at::Generator& generator);

// Returns the same residual covariance over all actions together, [T, 3].
at::Tensor PooledCovariance(const Predictions& predictions);

// Returns the gradient of L by the covariance of each example and action, [N, K, T, 3]. L is the
// mean of -ln p over all waypoints of all examples, and p the mixture over log_probabilities.
// Computes a batch of examples at a time, so it takes little more memory than its result. The
// batches do not change the bits.
//   covariance: the answers' covariance, the sum of the latent's and the decoder's, [N, K, T, 3]
at::Tensor NllGradient(const Predictions& predictions, const at::Tensor& covariance);

// Returns the predictions of the action with the largest q(y|x,s) alone. [N, 1, ..]
Predictions OfOwnAction(const Predictions& predictions);

// The scale that makes held-out trajectories most likely under the four actions with the largest
// q(y|x,s). Residuals on training examples are too small. p(y|s) is not used here: neighbouring
// actions would then make up for one that is too narrow.
struct CovarianceScale {
  at::Tensor factor;           // of the decoder's covariance at each waypoint, exp(a + b t), [T]
  double latent_stddev = 1.0;  // factor of the standard deviations of q(z|y,s), in [1/3, 3]
};

// Fits the scale to held-out predictions.
//   covariance: the decoder's, [K, T, 3], or one for each example, [N, K, T, 3]
//   fit_latent: whether to fit latent_stddev too; otherwise it stays 1
CovarianceScale FitCovarianceScale(const Predictions& held_out, const at::Tensor& covariance,
                                   bool fit_latent);

// Return the steps that the two fits take for this many examples.
PlannedSteps DecoderCovarianceSteps(int64_t examples);
PlannedSteps CovarianceScaleSteps(int64_t examples);

// Returns the share of waypoints that lie in the 2-sigma ellipse of the action that the example
// belongs to, counted as in an evaluation. A Gaussian has 1 - exp(-2).
//   covariance: the decoder's, as above
double CoveredShare(const Predictions& predictions, const at::Tensor& covariance);

// Returns the smallest factor for the decoder's covariance, from 1/16 to 16, that makes
// CoveredShare at least `share`.
double ScaleToCover(const Predictions& held_out, const at::Tensor& covariance, double share);

// Returns the same, but at least 1.
double WidenToCover(const Predictions& held_out, const at::Tensor& covariance, double share);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_COVARIANCE_FIT_H_
