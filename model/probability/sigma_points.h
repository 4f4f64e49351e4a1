// Sigma points: 2D+1 points that represent a Gaussian in latent space. The images of the points
// under a decoder give the moments of its output, without sampling.
//
// The points are the mean and, along each dimension, one standard deviation to either side of it,
// as in the paper's figures. Let x_0 be the image of the mean, and x+_d and x-_d those of the pair
// along d:
//
//   mean         x_0 + 1/2 sum_d (x+_d - 2 x_0 + x-_d)
//   covariance   sum_d h_d h_d^T,   h_d = (x+_d - x-_d) / 2
//
// Both are exact for a linear decoder f(z) = A z + b: the second differences vanish and sum_d h_d
// h_d^T = A Sigma A^T. The mean is also exact for a quadratic decoder, because E xi_i xi_j = 0 for
// i != j.
//
// The unscented transform with points at one standard deviation has the weights 1 - D and 1/2. Its
// mean is the same. For D > 1 its covariance has a negative weight and need not be a covariance.
// The covariance from central differences is positive semi-definite for any decoder. Adding 1/2 c_d
// c_d^T of the second differences c_d would make it exact for separable quadratics. On arcs and on
// random ReLU networks with D = 5, that overestimated deviations by up to 40 %; without it they are
// within 10 %.

#ifndef MANEUVER_MODEL_PROBABILITY_SIGMA_POINTS_H_
#define MANEUVER_MODEL_PROBABILITY_SIGMA_POINTS_H_

#include <Eigen/Core>

namespace maneuver::probability {

// One point per row, row-major.
using RowMajorXd = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Returns the points, [2D+1, D]: the mean, then + and - one standard deviation along each
// dimension.
RowMajorXd SigmaPoints(const Eigen::VectorXd& mean, const Eigen::VectorXd& stddev);

struct SigmaMoments {
  Eigen::VectorXd mean;   // [N]
  RowMajorXd deviations;  // [D, N] rows h_d: the covariance is their sum of outer products

  Eigen::MatrixXd Covariance() const { return deviations.transpose() * deviations; }  // [N, N]
};

// Sets the moments of a decoder's output. Reuses the memory of `moments`.
//   images: [2D+1, N], of the points in the order of SigmaPoints.
void MomentsOfSigmaPoints(const RowMajorXd& images, SigmaMoments* moments);

// Returns E ln N(x; f(z), stddev^2 I) over the Gaussian whose sigma points have these moments under
// f. Uses E |x - f(z)|^2 = |x - E f(z)|^2 + tr Cov f(z). Exact for a linear decoder.
double ExpectedLogDensity(const Eigen::VectorXd& x, const SigmaMoments& moments, double stddev);

}  // namespace maneuver::probability

#endif  // MANEUVER_MODEL_PROBABILITY_SIGMA_POINTS_H_
