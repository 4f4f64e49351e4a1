// Places the components of p(z|y) before they are learned.

#ifndef MANEUVER_MODEL_LEARNING_MIXTURE_PLACEMENT_H_
#define MANEUVER_MODEL_LEARNING_MIXTURE_PLACEMENT_H_

#include <cstdint>
#include <vector>

#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/gaussian.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// A mixture of K diagonal Gaussians with the logarithms of its weights.
struct PlacedMixture {
  Gaussian components;     // [K, D]
  at::Tensor log_weights;  // [K], normalised
  // The clusters' centres in the space of ClusterSpace, [C, S]; undefined for other placements.
  // They are of the last C components; those before them were placed by labels.
  at::Tensor centers = {};
};

// The time between the waypoints of a trajectory, and the speed that counts as slow.
struct TrajectoryScale {
  double waypoint_interval = 0.0;  // seconds
  double slow_speed = 1.0;         // metres per second; distances are linear in speeds below it
};

TrajectoryScale ScaleOf(const v1::TrainingSettings& settings);

// The examples that a mixture is placed by.
struct EncodedExamples {
  at::Tensor trajectories;  // x, [N, 2T] metres, on the CPU
  TrajectoryScale scale;
  Gaussian q_z;  // q(z|x), [N, D], on the CPU
};

// Returns the points at which TRAJECTORY_, VELOCITY_ and DEPARTURE_CLUSTERS measure distances. [N,
// S]
at::Tensor ClusterSpace(v1::MixturePlacement placement, const at::Tensor& trajectories,
                        const TrajectoryScale& scale);

// Returns the index of the centre nearest to each trajectory. [N]
at::Tensor NearestClusters(v1::MixturePlacement placement, const at::Tensor& centers,
                           const at::Tensor& trajectories, const TrajectoryScale& scale);

// Returns a mixture of `actions` components. The same seed gives the same mixture. Clusters may be
// empty, for instance if there are fewer different trajectories than actions. Their components are
// N(0, I) and weigh as much as a cluster of one example.
//   TRAJECTORY_CLUSTERS  k-means on the trajectories, in a space that compresses large distances
//                        and counts lateral ones twice. In plain metres nearly all clusters would
//                        differ only in the speed of going straight, which q(z|y,s) knows from the
//                        scenario anyway
//   VELOCITY_CLUSTERS    k-means on the velocities along the trajectories, with compressed speeds
//                        (ln(1 + v / slow)): clusters differ by what is done, not by where it leads
//   DEPARTURE_CLUSTERS   k-means on the positions at t = 0.5 s, 1 s, ..., each divided by
//                        sqrt(t + 0.5 s); for trajectories relative to a reference. Takes every
//                        n-th waypoint, n the number of intervals nearest to 0.5 s
//   RANDOM               means from N(0, I), variances 1
//   UNIFORM              means drawn uniformly from the box around the encodings
//   ENCODED_POINTS       means at the encodings of random examples
//   ENCODED_SEEDS        means at k-means++ seeds among the encodings
//   FITTED_MIXTURE       expectation maximisation from these seeds
// Points and seeds get the variance of all encodings divided by K^(2/D), a component's share of it.
// So do clusters of fewer than 10 examples.
PlacedMixture PlaceMixture(v1::MixturePlacement placement, const EncodedExamples& examples,
                           int actions, uint64_t seed);

// Places the first `labelled` components at the examples of labels 0 .. labelled-1 (mean and
// variance of their encodings), and the others as PlaceMixture does, by the examples without a
// label. If there are fewer of these than actions, it places the others by all examples.
//   labels: [N], -1 where there is none
PlacedMixture PlaceLabelledMixture(v1::MixturePlacement placement, const EncodedExamples& examples,
                                   const std::vector<int>& labels, int labelled, int actions,
                                   uint64_t seed);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_MIXTURE_PLACEMENT_H_
