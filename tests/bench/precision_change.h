// Measures how much a faster precision changes the answers.

#ifndef MANEUVER_TESTS_BENCH_PRECISION_CHANGE_H_
#define MANEUVER_TESTS_BENCH_PRECISION_CHANGE_H_

#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "tests/bench/bench_model.h"

namespace maneuver::bench {

// Absolute differences of two precisions' answers for the same targets.
struct PrecisionChange {
  int targets = 0;
  double largest_probability = 0.0;  // of p(y|s), over targets and actions
  double mean_probability = 0.0;
  // Distance between waypoints of an action's mean trajectories, metres; for actions with p(y|s) of
  // at least kLikely in f32.
  double largest_waypoint = 0.0;
  double mean_waypoint = 0.0;
};
inline constexpr double kLikely = 0.05;

// Compares the loaded model with itself in f32.
//   scenes: at least one, each with at most kLargestBatch targets
PrecisionChange ChangeFromF32(const BenchModel& model, const std::vector<v1::Scenario>& scenes);

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_PRECISION_CHANGE_H_
