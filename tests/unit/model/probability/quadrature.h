// Integrates in one and two dimensions by the trapezoidal rule. For functions that vanish at both
// ends, it is exact up to rounding.

#ifndef MANEUVER_TESTS_UNIT_MODEL_PROBABILITY_QUADRATURE_H_
#define MANEUVER_TESTS_UNIT_MODEL_PROBABILITY_QUADRATURE_H_

#include <cmath>
#include <numbers>

namespace maneuver::probability {

// Returns N(z; mean, variance), written out.
inline double NormalDensity(double z, double mean, double variance) {
  return std::exp(-(z - mean) * (z - mean) / (2 * variance)) /
         std::sqrt(2 * std::numbers::pi * variance);
}

template <typename Function>
double Integrate(Function f, double low, double high, int steps) {
  const double step = (high - low) / steps;
  double sum = 0.5 * (f(low) + f(high));
  for (int i = 1; i < steps; ++i) sum += f(low + i * step);
  return sum * step;
}

}  // namespace maneuver::probability

#endif  // MANEUVER_TESTS_UNIT_MODEL_PROBABILITY_QUADRATURE_H_
