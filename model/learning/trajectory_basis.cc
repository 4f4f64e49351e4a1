#include "model/learning/trajectory_basis.h"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>

namespace maneuver::learning {
namespace {

constexpr int kDegree = 3;

// Values at `time` of the B-splines of kDegree on clamped uniform knots, by the Cox-de Boor
// recursion. [intervals + kDegree]
Eigen::VectorXd BSplines(double time, double horizon, int intervals) {
  const auto knot = [&](int i) {
    return horizon * std::clamp(i - kDegree, 0, intervals) / intervals;
  };
  const int knots = intervals + 2 * kDegree + 1;
  Eigen::VectorXd values = Eigen::VectorXd::Zero(knots - 1);
  // The last interval is closed, so that the curve has an end.
  const int within = std::min(static_cast<int>(time / horizon * intervals), intervals - 1);
  values[within + kDegree] = 1.0;
  for (int degree = 1; degree <= kDegree; ++degree) {
    for (int i = 0; i + degree + 1 < knots; ++i) {
      const double rise = knot(i + degree) - knot(i);
      const double fall = knot(i + degree + 1) - knot(i + 1);
      values[i] = (rise > 0.0 ? (time - knot(i)) / rise * values[i] : 0.0) +
                  (fall > 0.0 ? (knot(i + degree + 1) - time) / fall * values[i + 1] : 0.0);
    }
  }
  return values.head(intervals + kDegree);
}

}  // namespace

Eigen::MatrixXf SplineBasis(std::span<const double> waypoint_times, double knot_interval) {
  const int waypoints = static_cast<int>(waypoint_times.size());
  const double horizon = waypoint_times.back();
  const int intervals = std::max(1, static_cast<int>(std::lround(horizon / knot_interval)));
  // All but the first, which alone is not 0 at time 0.
  const int functions = intervals + kDegree - 1;
  if (functions >= waypoints) return Eigen::MatrixXf::Identity(waypoints, waypoints);
  Eigen::MatrixXd splines(waypoints, functions);
  for (int t = 0; t < waypoints; ++t) {
    splines.row(t) =
        BSplines(waypoint_times[static_cast<size_t>(t)], horizon, intervals).tail(functions);
  }
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(splines);
  return (qr.householderQ() * Eigen::MatrixXd::Identity(waypoints, functions)).cast<float>();
}

}  // namespace maneuver::learning
