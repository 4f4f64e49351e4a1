// Trajectories given by formulas.

#ifndef MANEUVER_TESTS_UNIT_MODEL_EVALUATION_DRIVEN_TRAJECTORY_H_
#define MANEUVER_TESTS_UNIT_MODEL_EVALUATION_DRIVEN_TRAJECTORY_H_

#include <functional>
#include <vector>

#include "model/inference/trajectory_set.h"

namespace maneuver::evaluation {

// Five seconds at 10 Hz: 0.1 s, 0.2 s, ... 5 s.
inline std::vector<double> Times() {
  std::vector<double> times;
  for (int i = 1; i <= 50; ++i) times.push_back(0.1 * i);
  return times;
}

// Samples a function of time in seconds at Times(). [50, 2] metres, target frame
inline inference::Trajectory Driven(const std::function<Eigen::RowVector2d(double)>& place) {
  inference::Trajectory trajectory(50, 2);
  for (int i = 0; i < 50; ++i) trajectory.row(i) = place(0.1 * (i + 1));
  return trajectory;
}

}  // namespace maneuver::evaluation

#endif  // MANEUVER_TESTS_UNIT_MODEL_EVALUATION_DRIVEN_TRAJECTORY_H_
