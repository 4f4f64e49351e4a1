// Displacement errors of predicted trajectories, as Argoverse 2 and nuScenes define them.

#ifndef MANEUVER_MODEL_EVALUATION_DISPLACEMENT_H_
#define MANEUVER_MODEL_EVALUATION_DISPLACEMENT_H_

#include <span>

#include "model/inference/action_model.h"

namespace maneuver::evaluation {

using inference::Trajectory;

// Returns the ADE: the mean Euclidean distance over the waypoints, metres.
double AverageDisplacement(const Trajectory& predicted, const Trajectory& truth);

// Returns the FDE: the Euclidean distance at the last waypoint, metres.
double FinalDisplacement(const Trajectory& predicted, const Trajectory& truth);

// Returns the largest Euclidean distance at any waypoint, metres.
double LargestDisplacement(const Trajectory& predicted, const Trajectory& truth);

struct DisplacementErrors {
  double min_ade = 0.0;  // metres, over the first k
  double min_fde = 0.0;  // metres, over the first k
  // Argoverse 2: min_fde + (1 - p)^2, where p is the probability of the trajectory with that FDE,
  // renormalised over the first k.
  double brier_fde = 0.0;
  bool missed_argoverse = false;  // Argoverse 2: no FDE within 2 m; exactly 2 m is a hit
  // nuScenes: no trajectory stays nearer than 2 m at every waypoint. Exactly 2 m is a miss, as in
  // the nuScenes devkit.
  bool missed_nuscenes = false;
};

// Returns the errors of the best of the first k of `ranked`, most probable first. k may exceed
// their number. Each error is minimised on its own, except the probability in brier_fde.
//   probabilities: one per trajectory; need not sum to 1.
DisplacementErrors BestOf(std::span<const Trajectory> ranked, std::span<const double> probabilities,
                          int k, const Trajectory& truth);

// Returns the errors of one trajectory with probability 1.
DisplacementErrors ErrorsOf(const Trajectory& predicted, const Trajectory& truth);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_DISPLACEMENT_H_
