// How probable the truth was under what was predicted.

#ifndef MANEUVER_MODEL_EVALUATION_LIKELIHOOD_H_
#define MANEUVER_MODEL_EVALUATION_LIKELIHOOD_H_

#include <span>

#include "model/inference/action_model.h"

namespace maneuver::evaluation {

// All are of Gaussians N(m_yt, C_yt) with the moments of action y's distribution at waypoint t:
// those of its sigma points, plus the decoder's covariance.

// -1/T ln N(x_t; m_t, C_t) summed over the waypoints: of one action, nats a waypoint.
double GaussianNll(const inference::ActionDistribution& distribution,
                   const inference::Trajectory& truth);

struct MixtureNll {
  // -1/T sum_t ln sum_y p_y N(x_t; m_yt, C_yt): each waypoint on its own, nats a waypoint.
  double marginal = 0.0;
  // -ln sum_y p_y prod_t N(x_t; m_yt, C_yt): the whole trajectory was one action, given which the
  // waypoints are independent; nats a trajectory. Errors of neighbouring waypoints are alike, which
  // this model of them does not know: it punishes an action that is off all along.
  double joint = 0.0;
};

//   probabilities: p(y|s) of each distribution; renormalised over them
MixtureNll MixtureNllOf(std::span<const inference::ActionDistribution> distributions,
                        std::span<const double> probabilities, const inference::Trajectory& truth);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_LIKELIHOOD_H_
