// Measures whether an action's envelope of trajectories contains the truth, and how wide it is.

#ifndef MANEUVER_MODEL_EVALUATION_ENVELOPE_H_
#define MANEUVER_MODEL_EVALUATION_ENVELOPE_H_

#include "model/evaluation/gaussian_shares.h"
#include "model/inference/action_model.h"

namespace maneuver::evaluation {

using inference::WaypointCovariances;

// Returns the covariance from the latent alone: sum_d h_d h_d^T over the sigma points, without the
// decoder's covariance (model/probability/sigma_points.h).
WaypointCovariances LatentCovariance(const inference::ActionDistribution& distribution);

// Shares of the waypoints t whose truth lies in the n-sigma ellipse, edge included:
//   (x_t - m_t)^T C_t^-1 (x_t - m_t) <= n^2.
// A Gaussian contains kGaussianOneSigma or kGaussianTwoSigma of them. A singular C_t contains
// nothing.
struct Coverage {
  double one_sigma = 0.0;
  double two_sigma = 0.0;
};

Coverage CoverageOf(const inference::Trajectory& mean, const WaypointCovariances& covariance,
                    const inference::Trajectory& truth);

// Returns the mean over the waypoints of sqrt(trace(C_t) / 2), metres. For a circle, that is the
// standard deviation of each coordinate.
double MeanSigma(const WaypointCovariances& covariance);

// How well one action's distribution encloses the truth.
struct Envelope {
  Coverage whole;           // with the decoder's covariance
  Coverage latent;          // with the latent's covariance alone
  double mean_sigma = 0.0;  // with the latent's covariance alone, metres
};

Envelope EnvelopeOf(const inference::ActionDistribution& distribution,
                    const inference::Trajectory& truth);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ENVELOPE_H_
