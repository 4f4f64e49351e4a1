// Whether an action's envelope of trajectories holds the truth, and how wide it is.

#ifndef MANEUVER_MODEL_EVALUATION_ENVELOPE_H_
#define MANEUVER_MODEL_EVALUATION_ENVELOPE_H_

#include "model/inference/action_model.h"

namespace maneuver::evaluation {

using inference::WaypointCovariances;

// What the latent alone spreads: sum_d h_d h_d^T over the sigma points, without the decoder's
// covariance (model/probability/sigma_points.h).
WaypointCovariances LatentCovariance(const inference::ActionDistribution& distribution);

// Shares of the waypoints t whose truth lies in the n-sigma ellipse, on its edge included:
//   (x_t - m_t)^T C_t^-1 (x_t - m_t) <= n^2.
// A 2-D Gaussian holds 1 - exp(-n^2 / 2): 39.3 % for n = 1, 86.5 % for n = 2. Where C_t is singular
// nothing lies in it.
struct Coverage {
  double one_sigma = 0.0;
  double two_sigma = 0.0;
};

Coverage CoverageOf(const inference::Trajectory& mean, const WaypointCovariances& covariance,
                    const inference::Trajectory& truth);

inline constexpr double kGaussianOneSigma = 0.393469;  // 1 - exp(-1/2)
inline constexpr double kGaussianTwoSigma = 0.864665;  // 1 - exp(-2)

// Mean over the waypoints of sqrt(trace(C_t) / 2), metres: of a circle, its standard deviation on
// each coordinate.
double MeanSigma(const WaypointCovariances& covariance);

// How one action's distribution encloses the truth.
struct Envelope {
  Coverage whole;           // with the decoder's covariance
  Coverage latent;          // with the latent's alone
  double mean_sigma = 0.0;  // of the latent alone, metres
};

Envelope EnvelopeOf(const inference::ActionDistribution& distribution,
                    const inference::Trajectory& truth);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ENVELOPE_H_
