// How probable the truth was under what was predicted.

#ifndef MANEUVER_MODEL_EVALUATION_LIKELIHOOD_H_
#define MANEUVER_MODEL_EVALUATION_LIKELIHOOD_H_

#include <span>

#include "model/inference/action_model.h"

namespace maneuver::evaluation {

// Negative log-likelihood of `truth` a waypoint, nats: at each waypoint a mixture over the actions
// given, weighted by p(y|s) renormalised over them, of Gaussians with the moments of their
// distributions; averaged over the waypoints (the marginal NLL, not that of the joint).
//   probabilities: p(y|s) of each distribution
double MixtureNll(std::span<const inference::ActionDistribution> distributions,
                  std::span<const double> probabilities, const inference::Trajectory& truth);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_LIKELIHOOD_H_
