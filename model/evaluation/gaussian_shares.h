// How much of a Gaussian lies within n standard deviations.

#ifndef MANEUVER_MODEL_EVALUATION_GAUSSIAN_SHARES_H_
#define MANEUVER_MODEL_EVALUATION_GAUSSIAN_SHARES_H_

namespace maneuver::evaluation {

// The share of a Gaussian in the plane within its n-sigma ellipse, 1 - exp(-n^2 / 2).
inline constexpr double kGaussianOneSigma = 0.393469340287366576;
inline constexpr double kGaussianTwoSigma = 0.864664716763387308;

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_GAUSSIAN_SHARES_H_
