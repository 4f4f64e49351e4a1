#ifndef MANEUVER_TESTS_UNIT_MODEL_PROBABILITY_LOG_DENSITY_H_
#define MANEUVER_TESTS_UNIT_MODEL_PROBABILITY_LOG_DENSITY_H_

#include <cmath>

#include "model/probability/diagonal_gaussian.h"
#include "tests/unit/model/probability/quadrature.h"

namespace maneuver::probability {

// Returns ln p(z).
inline double LogDensity(const DiagonalGaussian& p, const Eigen::VectorXd& z) {
  double log_density = 0.0;
  for (Eigen::Index d = 0; d < z.size(); ++d) {
    log_density += std::log(NormalDensity(z[d], p.mean[d], std::exp(p.log_variance[d])));
  }
  return log_density;
}

}  // namespace maneuver::probability

#endif  // MANEUVER_TESTS_UNIT_MODEL_PROBABILITY_LOG_DENSITY_H_
