// Displacement errors of predicted trajectories, as Argoverse 2 and nuScenes define them.

#ifndef MANEUVER_MODEL_EVALUATION_DISPLACEMENT_H_
#define MANEUVER_MODEL_EVALUATION_DISPLACEMENT_H_

#include <span>

#include "model/inference/action_model.h"

namespace maneuver::evaluation {

using inference::Trajectory;

// ADE: mean Euclidean distance over the waypoints, metres.
double AverageDisplacement(const Trajectory& predicted, const Trajectory& truth);

// FDE: Euclidean distance at the last waypoint, metres.
double FinalDisplacement(const Trajectory& predicted, const Trajectory& truth);

// Largest Euclidean distance at any waypoint, metres.
double LargestDisplacement(const Trajectory& predicted, const Trajectory& truth);

struct DisplacementErrors {
  double min_ade = 0.0;  // metres, over the first k
  double min_fde = 0.0;  // metres, over the first k
  // Argoverse 2: min_fde + (1 - p)^2, p being the probability of the trajectory with that FDE,
  // renormalised over the first k.
  double brier_fde = 0.0;
  bool missed_argoverse = false;  // Argoverse 2: no FDE within 2 m; exactly 2 m is a hit
  // nuScenes: none stays nearer than 2 m at every waypoint; exactly 2 m is a miss, as its devkit
  // has it.
  bool missed_nuscenes = false;
};

// Errors of the best of the first k of `ranked`, the most probable first; k may exceed their
// number. Each error is minimised on its own, but for the probability in brier_fde.
//   probabilities: of each of `ranked`; need not sum to 1
DisplacementErrors BestOf(std::span<const Trajectory> ranked, std::span<const double> probabilities,
                          int k, const Trajectory& truth);

// Errors of one trajectory that is held for certain.
DisplacementErrors ErrorsOf(const Trajectory& predicted, const Trajectory& truth);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_DISPLACEMENT_H_
