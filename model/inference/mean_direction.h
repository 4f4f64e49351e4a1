// The direction of a predicted mean at each waypoint. It defines "along" and "across" for the
// covariance that a scene predicts.

#ifndef MANEUVER_MODEL_INFERENCE_MEAN_DIRECTION_H_
#define MANEUVER_MODEL_INFERENCE_MEAN_DIRECTION_H_

#include "model/inference/trajectory_set.h"

namespace maneuver::inference {

// Returns a unit vector u_t for each waypoint, target frame. [T, 2]
//
// d_t = m_t - m_{t-1} is a step of the mean; m_{-1} is the origin, the target's position now. u_t
// is the direction of the average of d over the existing waypoints within 0.2 s of t:
//
//   t - w .. t + w,   w = round(0.2 s / interval)
//
// u_t is (1, 0), the target's heading, if that mean is shorter than 0.5 m/s times the interval.
//
//   mean: [T, 2] target frame, metres, the reference included
//   waypoint_interval: seconds
Trajectory MeanDirections(const Trajectory& mean, double waypoint_interval);

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_MEAN_DIRECTION_H_
