// Clusters trajectories by k-means, in metres.

#ifndef MANEUVER_MODEL_LEARNING_TRAJECTORY_CLUSTERS_H_
#define MANEUVER_MODEL_LEARNING_TRAJECTORY_CLUSTERS_H_

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace maneuver::learning {

// Trajectories as rows, x_1, y_1, x_2, y_2, ..., metres. [N, 2T]
using TrajectoryRows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

struct TrajectoryClusters {
  TrajectoryRows centers;       // [K, 2T]
  std::vector<int> assignment;  // [N], 0 .. K-1
  double inertia = 0.0;         // sum of squared distances to the assigned centre, square metres
};

// Runs Lloyd's algorithm from k-means++ seeds `restarts` times and returns the best result. Each
// trajectory is assigned to its nearest centre. A cluster may be empty; some are if there are fewer
// than K different trajectories. The result depends only on the seed. Requires N >= K.
TrajectoryClusters ClusterTrajectories(const TrajectoryRows& trajectories, int clusters,
                                       uint64_t seed, int restarts);

// Draws k-means++ seeds: each is a row drawn with a probability proportional to its squared
// distance from the nearest earlier seed. [K, 2T]
TrajectoryRows DrawSeeds(const TrajectoryRows& rows, int clusters, uint64_t seed);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_TRAJECTORY_CLUSTERS_H_
