#include "model/learning/trajectory_clusters.h"

#include <algorithm>
#include <limits>
#include <random>
#include <utility>

namespace maneuver::learning {
namespace {

constexpr int kMaxIterations = 60;
constexpr double kConverged = 1e-4;  // relative change of the inertia

// Uniform in [0, 1), the same on every standard library.
double Uniform(std::mt19937_64& random) { return static_cast<double>(random() >> 11) * 0x1.0p-53; }

// k-means++ (Arthur and Vassilvitskii, 2007): each next centre with a probability in proportion to
// its squared distance from those before.
TrajectoryRows DrawSeeds(const TrajectoryRows& rows, int clusters, std::mt19937_64& random) {
  const Eigen::Index count = rows.rows();
  TrajectoryRows centers(clusters, rows.cols());
  Eigen::VectorXd nearest =
      Eigen::VectorXd::Constant(count, std::numeric_limits<double>::infinity());
  Eigen::Index chosen = static_cast<Eigen::Index>(Uniform(random) * static_cast<double>(count));
  for (int k = 0; k < clusters; ++k) {
    centers.row(k) = rows.row(chosen);
    nearest = nearest.cwiseMin(
        (rows.rowwise() - rows.row(chosen)).rowwise().squaredNorm().cast<double>());
    double remaining = Uniform(random) * nearest.sum();
    chosen = 0;
    for (Eigen::Index i = 0; i < count; ++i) {
      if (nearest[i] <= 0.0) continue;
      chosen = i;
      remaining -= nearest[i];
      if (remaining <= 0.0) break;
    }
  }
  return centers;
}

// Assigns each row to its nearest centre; squared distances to *distances.
void Assign(const TrajectoryRows& rows, const Eigen::VectorXf& squared_norms,
            TrajectoryClusters* result, Eigen::VectorXf* distances) {
  const TrajectoryRows products = rows * result->centers.transpose();  // [N, K]
  const Eigen::RowVectorXf center_norms = result->centers.rowwise().squaredNorm().transpose();
  result->inertia = 0.0;
  for (Eigen::Index i = 0; i < rows.rows(); ++i) {
    Eigen::Index best = 0;
    const float distance = (center_norms - 2.0F * products.row(i)).minCoeff(&best);
    result->assignment[static_cast<size_t>(i)] = static_cast<int>(best);
    (*distances)[i] = std::max(0.0F, distance + squared_norms[i]);
    result->inertia += (*distances)[i];
  }
}

// Moves each centre to the mean of its rows; an empty one to the row furthest from its own.
void MoveCenters(const TrajectoryRows& rows, TrajectoryClusters* result,
                 Eigen::VectorXf* distances) {
  Eigen::MatrixXd sums = Eigen::MatrixXd::Zero(result->centers.rows(), result->centers.cols());
  Eigen::VectorXd counts = Eigen::VectorXd::Zero(result->centers.rows());
  for (Eigen::Index i = 0; i < rows.rows(); ++i) {
    const int k = result->assignment[static_cast<size_t>(i)];
    sums.row(k) += rows.row(i).cast<double>();
    counts[k] += 1.0;
  }
  for (Eigen::Index k = 0; k < counts.size(); ++k) {
    if (counts[k] > 0.0) {
      result->centers.row(k) = (sums.row(k) / counts[k]).cast<float>();
    } else {
      Eigen::Index furthest = 0;
      distances->maxCoeff(&furthest);
      result->centers.row(k) = rows.row(furthest);
      (*distances)[furthest] = 0.0F;
    }
  }
}

}  // namespace

TrajectoryClusters ClusterTrajectories(const TrajectoryRows& trajectories, int clusters,
                                       uint64_t seed, int restarts) {
  std::mt19937_64 random(seed);
  const Eigen::VectorXf squared_norms = trajectories.rowwise().squaredNorm();
  Eigen::VectorXf distances(trajectories.rows());
  TrajectoryClusters best;
  best.inertia = std::numeric_limits<double>::infinity();
  for (int restart = 0; restart < restarts; ++restart) {
    TrajectoryClusters attempt;
    attempt.centers = DrawSeeds(trajectories, clusters, random);
    attempt.assignment.resize(static_cast<size_t>(trajectories.rows()));
    Assign(trajectories, squared_norms, &attempt, &distances);
    for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
      const double before = attempt.inertia;
      MoveCenters(trajectories, &attempt, &distances);
      Assign(trajectories, squared_norms, &attempt, &distances);
      if (before - attempt.inertia <= kConverged * attempt.inertia) break;
    }
    if (attempt.inertia < best.inertia) best = std::move(attempt);
  }
  return best;
}

TrajectoryRows DrawSeeds(const TrajectoryRows& rows, int clusters, uint64_t seed) {
  std::mt19937_64 random(seed);
  return DrawSeeds(rows, clusters, random);
}

}  // namespace maneuver::learning
