// Combines the actions of several targets: the most probable combinations whose expected
// trajectories are free of collisions.
//
// The model predicts each target i by itself, with P_i(k) = p(y_i = k | s). A combination c gives
// each target an action. Its score is
//
//   ln P(c) = sum_i ln P_i(c_i)   if no two targets i, j overlap under c_i and c_j
//             -infinity           otherwise
//
// The answer has the best combinations by this score, with the weights P(c) / sum P(c') over those
// that are returned.
//
// A target is a rectangle, length x width. Its centre moves on straight lines from its position at
// the prediction time through the waypoints of the action's mean trajectory. It points to where its
// centre moves between 0.2 s before and 0.2 s after the time; where that is less than 0.3 m, as
// before. Two targets overlap if their rectangles share area at one of the times at which they are
// looked at: the waypoints and equal steps of at most 0.1 s between them. Two targets that overlap
// at the prediction time, pointing as they do then, never exclude each other's actions.
//
// The search is best-first. A state fixes the actions of some targets, and holds for each other
// target the actions that overlap with none of them. Its bound is the sum of the fixed ln P and, of
// each other target, of the largest ln P that is left. No completion exceeds its bound, so complete
// states leave the queue in the order of their scores.

#ifndef MANEUVER_MODEL_INFERENCE_JOINT_COMBINATIONS_H_
#define MANEUVER_MODEL_INFERENCE_JOINT_COMBINATIONS_H_

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "model/inference/trajectory_set.h"
#include "model/scene/pose2.h"

namespace maneuver::inference {

inline constexpr size_t kMostJointTargets = 8;
inline constexpr size_t kMostJointActions = 12;  // of each target, the most probable
inline constexpr int kMostJointCombinations = 64;
inline constexpr int kMostJointSteps = 4096;  // states that a search may expand

// A target, and the actions of it that take part.
struct JointTarget {
  int64_t id = 0;       // differs from those of the others
  double length = 0.0;  // metres, > 0
  double width = 0.0;   // metres, > 0
  scene::Pose2 X_WT;    // at the prediction time
  // At most kMostJointActions, the most probable first.
  std::vector<int> actions = {};
  std::vector<double> log_probabilities = {};  // ln p(y|s) of each of them
  TrajectorySet means = {};                    // of each of them: target frame, metres
};

struct JointCombination {
  std::vector<int> actions;      // of each target, in their order
  double log_probability = 0.0;  // nats
  double weight = 0.0;           // in [0, 1]; the weights of an answer sum to 1
};

struct JointCombinations {
  std::vector<JointCombination> combinations;  // the most probable first
  bool truncated = false;  // the search ended at its bound: more combinations may follow
};

// Returns the actions of a target that take part: the kMostJointActions most probable ones with a
// probability of at least kNegligibleProbability (representatives.h), the most probable first. The
// smaller id wins ties.
//   probabilities: p(y|s), [K]
std::vector<int> JointActions(const Eigen::VectorXd& probabilities);

// Returns at most `count` combinations. The order of the targets does not matter: the same
// combinations come with the same bits. With one target they are its actions.
//   targets: at most kMostJointTargets; their trajectories have equal numbers of waypoints
//   waypoint_interval: between two waypoints, and before the first; seconds, > 0
//   most_steps: how many states the search may expand
JointCombinations CombineActions(std::span<const JointTarget> targets, double waypoint_interval,
                                 int count, int most_steps = kMostJointSteps);

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_JOINT_COMBINATIONS_H_
