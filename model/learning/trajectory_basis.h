// Smooth curves that the decoder's trajectories are made of.

#ifndef MANEUVER_MODEL_LEARNING_TRAJECTORY_BASIS_H_
#define MANEUVER_MODEL_LEARNING_TRAJECTORY_BASIS_H_

#include <Eigen/Core>
#include <span>

namespace maneuver::learning {

// Cubic splines over the horizon that start at 0 at time 0, with a knot about every `knot_interval`
// seconds, as orthonormal columns: row t holds the M basis functions at waypoint t. With fewer
// waypoints than functions, M = T and every trajectory can be made of them. [T, M]
//
// A vehicle's path has continuous velocity and acceleration; waypoints that the decoder is free to
// place one by one have neither, because a likelihood of about a metre a waypoint does not ask for
// them. The decoder's last layer yields M coefficients an axis in place of T positions; as the
// basis is linear, an exported model holds their product, an ordinary layer.
//   waypoint_times: [T] seconds, increasing, above 0
Eigen::MatrixXf SplineBasis(std::span<const double> waypoint_times, double knot_interval);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_TRAJECTORY_BASIS_H_
