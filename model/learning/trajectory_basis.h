// The smooth curves that the decoder's trajectories consist of.

#ifndef MANEUVER_MODEL_LEARNING_TRAJECTORY_BASIS_H_
#define MANEUVER_MODEL_LEARNING_TRAJECTORY_BASIS_H_

#include <Eigen/Core>
#include <span>

namespace maneuver::learning {

// Returns cubic splines over the horizon as orthonormal columns, [T, M]: row t holds the M basis
// functions at waypoint t. The splines are 0 at time 0 and have a knot about every `knot_interval`
// seconds. If there are fewer waypoints than functions, M = T, and the basis contains every
// trajectory.
//
// A vehicle's path has continuous velocity and acceleration. Waypoints that the decoder places one
// by one have neither, because a likelihood of about a metre per waypoint does not require them. So
// the decoder's last layer gives M coefficients per axis instead of T positions. Because the basis
// is linear, an exported model holds the product of both, an ordinary layer.
//   waypoint_times: [T] seconds, increasing, above 0
Eigen::MatrixXf SplineBasis(std::span<const double> waypoint_times, double knot_interval);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_TRAJECTORY_BASIS_H_
