// Chooses a few actions that represent the whole mixture. The first of them is the mixture's
// medoid: the best single answer by mean displacement.
//
// With p(y|s) = P_k and the mean trajectories m_k of the actions, D_jk is the mean distance between
// m_j and m_k over waypoints half a second apart. Representatives are chosen greedily:
//
//   first   argmin_j sum_k P_k D_jk, the medoid
//   next    argmin_j sum_k P_k min(C_k, D_jk), C_k = distance from k to the nearest one so far
//
// so that each one lowers the expected distance to the nearest representative as much as one action
// can. The first n of k representatives are therefore the n representatives. The weight of a
// representative is the probability of the actions that are nearer to it than to any other one.
// Equal costs and equal distances go to the smaller action id: the answer is deterministic.

#ifndef MANEUVER_MODEL_INFERENCE_REPRESENTATIVES_H_
#define MANEUVER_MODEL_INFERENCE_REPRESENTATIVES_H_

#include <Eigen/Core>
#include <span>
#include <vector>

#include "model/inference/trajectory_set.h"

namespace maneuver::inference {

// Actions less probable than this are left out: they neither count nor represent others. If more
// representatives are requested than there are other actions, they come last, the most probable
// first, with a weight of 0. All K of them together have a probability of less than K times this.
inline constexpr double kNegligibleProbability = 1e-4;

struct Representative {
  int action = 0;       // 0 .. K-1
  double weight = 0.0;  // in [0, 1]; the weights of all representatives of an answer sum to 1
};

// Returns the actions whose mean trajectories ChooseRepresentatives needs: those with a probability
// of at least kNegligibleProbability, by ascending id.
//   probabilities: p(y|s), [K]
std::vector<int> RepresentativeCandidates(const Eigen::VectorXd& probabilities);

// Returns min(count, K) representatives in the order in which they are chosen, each action once.
// The probabilities of the candidates are divided by their sum, as if they were the whole mixture.
// Takes time N^2 (T' + count) and memory N^2. T' is the number of compared waypoints: every n-th,
// counted back from the last, with n = round(0.5 s / waypoint_interval), at least 1.
//   probabilities: p(y|s), [K]
//   candidates: [N] by RepresentativeCandidates
//   means: [N] mean trajectories of the candidates, in one common frame, metres
//   waypoint_interval: between two waypoints, seconds, > 0
//   count: at least 0
std::vector<Representative> ChooseRepresentatives(const Eigen::VectorXd& probabilities,
                                                  std::span<const int> candidates,
                                                  const TrajectorySet& means,
                                                  double waypoint_interval, int count);

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_REPRESENTATIVES_H_
