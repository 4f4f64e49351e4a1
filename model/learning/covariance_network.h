// Learns the covariance of p(x|z) where it is a function of z.

#ifndef MANEUVER_MODEL_LEARNING_COVARIANCE_NETWORK_H_
#define MANEUVER_MODEL_LEARNING_COVARIANCE_NETWORK_H_

#include "model/learning/networks.h"
#include "model/learning/predictions.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Fits the network, from wherever it is, to
//   -E sum_y q(y|x,s) 1/T sum_t ln N(x_t; m_yt, latent_yt + Sigma_t(z_y)),
// z_y the mean of q(z|y,s): each action has to hold its own, and where the latent spreads enough
// nothing is added. Beginning at `pooled` whatever z.
//   predictions: of examples that were learned from
//   pooled: [T, 3] xx, xy, yy, square metres
void FitCovarianceNetwork(Networks& networks, const Predictions& predictions,
                          const at::Tensor& pooled, at::Generator& generator);

// Multiplies the covariance at each waypoint, whatever z. factor: [T]
void ScaleCovarianceNetwork(Networks& networks, const at::Tensor& factor);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_COVARIANCE_NETWORK_H_
