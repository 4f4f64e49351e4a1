#include "model/inference/representatives.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace maneuver::inference {
namespace {

constexpr double kComparedInterval = 0.5;  // seconds between waypoints that are compared

// Waypoints that are compared, side by side. [N, T', 2] as [N, 2T']
TrajectorySet::Rows ComparedWaypoints(const TrajectorySet& means, double waypoint_interval) {
  const auto stride = std::max<Eigen::Index>(1, std::lround(kComparedInterval / waypoint_interval));
  const Eigen::Index waypoints = means.empty() ? 0 : means[0].rows();
  const Eigen::Index compared = (waypoints + stride - 1) / stride;
  TrajectorySet::Rows rows(static_cast<Eigen::Index>(means.size()), 2 * compared);
  for (Eigen::Index n = 0; n < rows.rows(); ++n) {
    const auto mean = means[static_cast<size_t>(n)];
    for (Eigen::Index i = 0; i < compared; ++i) {
      rows.row(n).segment<2>(2 * i) = mean.row(waypoints - 1 - i * stride);
    }
  }
  return rows;
}

// D_jk: symmetric, 0 on the diagonal. [N, N] metres
Eigen::MatrixXd MeanDistances(const TrajectorySet::Rows& waypoints) {
  const Eigen::Index candidates = waypoints.rows();
  const Eigen::Index compared = waypoints.cols() / 2;
  Eigen::MatrixXd distances = Eigen::MatrixXd::Zero(candidates, candidates);
  for (Eigen::Index j = 0; j < candidates; ++j) {
    for (Eigen::Index k = 0; k < j; ++k) {
      double sum = 0.0;
      for (Eigen::Index i = 0; i < compared; ++i) {
        const double dx = waypoints(j, 2 * i) - waypoints(k, 2 * i);
        const double dy = waypoints(j, 2 * i + 1) - waypoints(k, 2 * i + 1);
        sum += std::sqrt(dx * dx + dy * dy);
      }
      distances(j, k) = distances(k, j) = sum / static_cast<double>(compared);
    }
  }
  return distances;
}

// Indices of the chosen candidates, in the order of choice.
//   weights: [N]; distances: [N, N]; count: at most N
std::vector<Eigen::Index> ChooseGreedily(const Eigen::VectorXd& weights,
                                         const Eigen::MatrixXd& distances, size_t count) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const Eigen::Index candidates = weights.size();
  std::vector<Eigen::Index> chosen;
  std::vector<bool> taken(static_cast<size_t>(candidates), false);
  Eigen::VectorXd nearest = Eigen::VectorXd::Constant(candidates, kInfinity);
  while (chosen.size() < count) {
    Eigen::Index best = -1;
    double least = kInfinity;
    for (Eigen::Index j = 0; j < candidates; ++j) {
      if (taken[static_cast<size_t>(j)]) continue;
      const double cost = weights.dot(nearest.cwiseMin(distances.col(j)));
      if (best >= 0 && !(cost < least)) continue;
      best = j;
      least = cost;
    }
    chosen.push_back(best);
    taken[static_cast<size_t>(best)] = true;
    nearest = nearest.cwiseMin(distances.col(best));
  }
  return chosen;
}

// Actions that are not candidates, the most probable first.
std::vector<int> OthersByProbability(const Eigen::VectorXd& probabilities,
                                     std::span<const int> candidates) {
  std::vector<int> others;
  for (int k = 0; k < probabilities.size(); ++k) {
    if (!std::ranges::binary_search(candidates, k)) others.push_back(k);
  }
  std::ranges::stable_sort(others,
                           [&](int a, int b) { return probabilities[a] > probabilities[b]; });
  return others;
}

}  // namespace

std::vector<int> RepresentativeCandidates(const Eigen::VectorXd& probabilities) {
  std::vector<int> actions;
  for (int k = 0; k < probabilities.size(); ++k) {
    if (probabilities[k] >= kNegligibleProbability) actions.push_back(k);
  }
  return actions;
}

std::vector<Representative> ChooseRepresentatives(const Eigen::VectorXd& probabilities,
                                                  std::span<const int> candidates,
                                                  const TrajectorySet& means,
                                                  double waypoint_interval, int count) {
  Eigen::VectorXd weights(static_cast<Eigen::Index>(candidates.size()));
  for (size_t n = 0; n < candidates.size(); ++n) {
    weights[static_cast<Eigen::Index>(n)] = probabilities[candidates[n]];
  }
  weights /= weights.sum();
  const Eigen::MatrixXd distances = MeanDistances(ComparedWaypoints(means, waypoint_interval));
  const std::vector<Eigen::Index> chosen =
      ChooseGreedily(weights, distances, std::min(static_cast<size_t>(count), candidates.size()));

  std::vector<Representative> representatives;
  for (const Eigen::Index n : chosen) {
    representatives.push_back({.action = candidates[static_cast<size_t>(n)]});
  }
  for (Eigen::Index k = 0; k < weights.size() && !chosen.empty(); ++k) {
    // Candidates ascend, so the smaller index is the smaller id.
    const auto nearer = [&](Eigen::Index a, Eigen::Index b) {
      return distances(a, k) != distances(b, k) ? distances(a, k) < distances(b, k) : a < b;
    };
    const auto nearest = std::ranges::min_element(chosen, nearer) - chosen.begin();
    representatives[static_cast<size_t>(nearest)].weight += weights[k];
  }
  for (const int action : OthersByProbability(probabilities, candidates)) {
    if (representatives.size() >= static_cast<size_t>(count)) break;
    representatives.push_back({.action = action});
  }
  return representatives;
}

}  // namespace maneuver::inference
