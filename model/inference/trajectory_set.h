// Stores many trajectories in one matrix.

#ifndef MANEUVER_MODEL_INFERENCE_TRAJECTORY_SET_H_
#define MANEUVER_MODEL_INFERENCE_TRAJECTORY_SET_H_

#include <Eigen/Core>
#include <cstddef>
#include <initializer_list>
#include <utility>

namespace maneuver::inference {

// Positions at the waypoints, target frame, metres. [T, 2]
using Trajectory = Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor>;

// Trajectories with equal numbers of waypoints. An answer has about fifty; a separate allocation
// for each would cost more than it is worth.
class TrajectorySet {
 public:
  // One trajectory per row: x and y of each waypoint. [N, 2T]
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  TrajectorySet() = default;
  explicit TrajectorySet(Rows rows) : rows_(std::move(rows)) {}
  TrajectorySet(std::initializer_list<Trajectory> trajectories) {
    if (trajectories.size() == 0) return;
    rows_.resize(static_cast<Eigen::Index>(trajectories.size()), trajectories.begin()->size());
    Eigen::Index row = 0;
    for (const Trajectory& trajectory : trajectories) {
      rows_.row(row++) = Eigen::Map<const Eigen::RowVectorXd>(trajectory.data(), rows_.cols());
    }
  }

  size_t size() const { return static_cast<size_t>(rows_.rows()); }
  bool empty() const { return rows_.rows() == 0; }
  // Returns a view of trajectory `i`, which points into the set.
  Eigen::Map<const Trajectory> operator[](size_t i) const {
    return {rows_.row(static_cast<Eigen::Index>(i)).data(), rows_.cols() / 2, 2};
  }

 private:
  Rows rows_;
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_TRAJECTORY_SET_H_
