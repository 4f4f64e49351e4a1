// Displacement errors of predicted trajectories, as Argoverse 2 and nuScenes define them.

#ifndef MANEUVER_MODEL_EVALUATION_DISPLACEMENT_H_
#define MANEUVER_MODEL_EVALUATION_DISPLACEMENT_H_

#include <span>

#include "model/inference/action_model.h"
#include "model/scene/pose2.h"

namespace maneuver::evaluation {

using inference::Trajectory;

// ADE: mean Euclidean distance over the waypoints, metres.
double AverageDisplacement(const Trajectory& predicted, const Trajectory& truth);

// FDE: Euclidean distance at the last waypoint, metres.
double FinalDisplacement(const Trajectory& predicted, const Trajectory& truth);

struct DisplacementErrors {
  double min_ade = 0.0;  // metres, over the first k
  double min_fde = 0.0;  // metres, over the first k
  bool missed = false;   // no FDE within 2 m (Argoverse 2)
};

// Errors of the best of the first k of `ranked`, the most probable first; k may exceed their
// number. ADE and FDE are each minimised on their own.
DisplacementErrors BestOf(std::span<const Trajectory> ranked, int k, const Trajectory& truth);

// The trajectory of one that keeps the velocity (vx, vy), m/s, it has at the origin.
//   waypoint_times: [T] seconds
Trajectory ConstantVelocity(double vx, double vy, std::span<const double> waypoint_times);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_DISPLACEMENT_H_
