// Measures how probable the truth is under a prediction.

#ifndef MANEUVER_MODEL_EVALUATION_LIKELIHOOD_H_
#define MANEUVER_MODEL_EVALUATION_LIKELIHOOD_H_

#include <span>

#include "model/inference/action_model.h"

namespace maneuver::evaluation {

// All likelihoods are those of Gaussians N(m_yt, C_yt) with the moments of action y's distribution
// at waypoint t: the moments of its sigma points plus the decoder's covariance.

// How far the truth is off at a waypoint, by the covariance C_t.
struct WaypointDistance {
  double squared_distance = 0.0;  // (x_t - m_t)^T C_t^-1 (x_t - m_t); not finite if C_t is singular
  double determinant = 0.0;       // of C_t, metres^4
};

//   mean: m, [T, 2] metres;  covariance: C, [T, 3];  truth: x, [T, 2] metres
WaypointDistance DistanceAt(const inference::Trajectory& mean,
                            const inference::WaypointCovariances& covariance,
                            const inference::Trajectory& truth, Eigen::Index t);

// Returns -1/T sum_t ln N(x_t; m_t, C_t) of one action, nats per waypoint.
double GaussianNll(const inference::ActionDistribution& distribution,
                   const inference::Trajectory& truth);

struct MixtureNll {
  // -1/T sum_t ln sum_y p_y N(x_t; m_yt, C_yt): each waypoint on its own, nats per waypoint.
  double marginal = 0.0;
  // -ln sum_y p_y prod_t N(x_t; m_yt, C_yt), nats per trajectory. The whole trajectory is one
  // action, given which the waypoints are independent. In reality errors of neighbouring waypoints
  // are alike, so this value punishes an action that is off throughout.
  double joint = 0.0;
};

// Returns the likelihood of the truth under the mixture of all actions.
//   probabilities: p(y|s) of each distribution; renormalised to sum to 1
MixtureNll MixtureNllOf(std::span<const inference::ActionDistribution> distributions,
                        std::span<const double> probabilities, const inference::Trajectory& truth);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_LIKELIHOOD_H_
