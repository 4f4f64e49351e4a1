// Learns the covariance of p(x|z) for models in which it is a function of z.

#ifndef MANEUVER_MODEL_LEARNING_COVARIANCE_NETWORK_H_
#define MANEUVER_MODEL_LEARNING_COVARIANCE_NETWORK_H_

#include <cstdint>

#include "model/learning/calibration_steps.h"
#include "model/learning/networks.h"
#include "model/learning/predictions.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Fits the network by minimising
//   -E sum_y q(y|x,s) 1/T sum_t ln N(x_t; m_yt, latent_yt + Sigma_t(z_y)),
// where z_y is the mean of q(z|y,s). So each action must fit its own examples, and nothing is added
// where the latent spreads enough. The network begins as the constant `pooled`.
//   predictions: those for the training examples
//   pooled: [T, 3] xx, xy, yy, square metres
void FitCovarianceNetwork(Networks& networks, const Predictions& predictions,
                          const at::Tensor& pooled, at::Generator& generator);
// Returns the steps that the fit takes for this many examples.
PlannedSteps CovarianceNetworkSteps(int64_t examples);

// Multiplies the covariance at each waypoint, for every z. factor: [T]
void ScaleCovarianceNetwork(Networks& networks, const at::Tensor& factor);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_COVARIANCE_NETWORK_H_
