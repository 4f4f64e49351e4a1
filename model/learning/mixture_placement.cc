#include "model/learning/mixture_placement.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "model/artifact/model_spec.h"
#include "model/learning/networks.h"
#include "model/learning/trajectory_clusters.h"

namespace maneuver::learning {
namespace {

constexpr int kClusterRestarts = 3;
constexpr double kSidewaysWeight = 2.0;
constexpr double kReach = 10.0;          // metres
constexpr double kVelocityWindow = 0.5;  // seconds
// Variance of a component that starts from few encodings.
constexpr double kSmallestVariance = 1e-3;
// Components with fewer encodings get their share of the variance of all.
constexpr int64_t kFewEncodings = 10;
constexpr int kFitIterations = 50;

at::Tensor PositionSpace(const at::Tensor& trajectories) {
  const at::Tensor points = trajectories.view({trajectories.size(0), -1, 2});
  const at::Tensor reach = points.square().sum(2).amax(1).sqrt().view({-1, 1, 1});
  const at::Tensor weights = at::tensor({1.0F, static_cast<float>(kSidewaysWeight)});
  return (points * weights / (1.0 + reach / kReach).sqrt()).flatten(1).contiguous();
}

// Velocities over half seconds, v ln(1 + |v| / slow) / |v|: of fast ones it is their ratios that
// count. [N, 2S]
at::Tensor VelocitySpace(const at::Tensor& trajectories, const TrajectoryScale& scale) {
  const at::Tensor points = trajectories.view({trajectories.size(0), -1, 2});
  const int64_t waypoints = points.size(1);
  const int64_t stride = std::clamp<int64_t>(
      std::llround(kVelocityWindow / scale.waypoint_interval), 1, std::max<int64_t>(1, waypoints));
  const at::Tensor passed = points.slice(1, stride - 1, waypoints, stride);
  const at::Tensor from = at::cat({at::zeros_like(points.slice(1, 0, 1)), passed}, 1);
  const at::Tensor velocity =
      from.diff(1, 1) / (static_cast<double>(stride) * scale.waypoint_interval);
  const at::Tensor speed = velocity.square().sum(2, /*keepdim=*/true).sqrt().clamp_min(1e-6);
  return (velocity * ((speed / scale.slow_speed).log1p() / speed)).flatten(1).contiguous();
}

TrajectoryClusters Cluster(const at::Tensor& rows, int clusters, uint64_t seed, int restarts) {
  const at::Tensor dense = rows.contiguous();
  return ClusterTrajectories(
      Eigen::Map<const TrajectoryRows>(dense.data_ptr<float>(), dense.size(0), dense.size(1)),
      clusters, seed, restarts);
}

// Mean and variance of the marginal sum_i q(z|x_i) / N over the rows. [D] each
Gaussian Moments(const Gaussian& q_z) {
  const at::Tensor mean = q_z.mean.mean(0);
  const at::Tensor variance = q_z.mean.var(0, /*unbiased=*/false) + q_z.log_variance.exp().mean(0);
  return {mean, variance.clamp_min(kSmallestVariance).log()};
}

// Positions every half second, each over the root of its time plus half a second: departures from a
// reference grow with the time. [N, S]
at::Tensor DepartureSpace(const at::Tensor& trajectories, const TrajectoryScale& scale) {
  constexpr double kStep = 0.5;  // seconds
  const int64_t every = std::max<int64_t>(1, std::lround(kStep / scale.waypoint_interval));
  const at::Tensor points = trajectories.view({trajectories.size(0), -1, 2});
  const int64_t first = std::min(every, points.size(1)) - 1;
  const at::Tensor index = at::arange(first, points.size(1), every, at::kLong);
  const at::Tensor times = (index + 1).to(at::kFloat) * scale.waypoint_interval;
  return (points.index_select(1, index) / (times + kStep).sqrt().view({1, -1, 1})).flatten(1);
}

Gaussian Rows(const Gaussian& q_z, const at::Tensor& rows) {
  return {q_z.mean.index_select(0, rows), q_z.log_variance.index_select(0, rows)};
}

at::Tensor EvenWeights(int actions) {
  return at::full({actions}, -std::log(static_cast<double>(actions)), at::kFloat);
}

// A component's share of a variance: 1 / K^(2/D).
double ShareOfVariance(int64_t actions, int64_t dimensions) {
  return std::pow(static_cast<double>(actions), -2.0 / static_cast<double>(dimensions));
}

// The log-variance of a component that its own encodings do not tell. [D]
at::Tensor SharedLogVariance(const Gaussian& q_z, int64_t actions) {
  const at::Tensor variance =
      Moments(q_z).log_variance.exp() * ShareOfVariance(actions, q_z.mean.size(1));
  return variance.clamp_min(kSmallestVariance).log();
}

// Components at the means [K, D], of even weight and size.
PlacedMixture PlacedAt(const at::Tensor& means, const Gaussian& q_z) {
  const int64_t actions = means.size(0);
  return {{means, SharedLogVariance(q_z, actions).expand_as(means).clone()},
          EvenWeights(static_cast<int>(actions))};
}

// Each component from the encodings that are assigned to it.
PlacedMixture PlacedByClusters(const std::vector<int>& assignment, const Gaussian& q_z,
                               int actions) {
  const at::Tensor cluster = at::tensor(at::ArrayRef<int>(assignment), at::kLong);
  const at::Tensor shared = SharedLogVariance(q_z, actions);
  PlacedMixture placed{
      {at::zeros({actions, q_z.mean.size(1)}), at::zeros({actions, q_z.mean.size(1)})},
      at::empty({actions}, at::kFloat)};
  for (int k = 0; k < actions; ++k) {
    const at::Tensor members = (cluster == k).nonzero().flatten();
    const int64_t size = members.size(0);
    // An empty cluster weighs as much as one of a single encoding.
    placed.log_weights[k].fill_(std::log(static_cast<double>(std::max<int64_t>(1, size)) /
                                         static_cast<double>(assignment.size())));
    if (size == 0) continue;
    const Gaussian moments = Moments(Rows(q_z, members));
    placed.components.mean[k].copy_(moments.mean);
    placed.components.log_variance[k].copy_(size < kFewEncodings ? shared : moments.log_variance);
  }
  placed.log_weights = at::log_softmax(placed.log_weights, 0);
  return placed;
}

// k-means++ seeds among the encodings. [K, D]
at::Tensor Seeds(const Gaussian& q_z, int actions, uint64_t seed) {
  const at::Tensor dense = q_z.mean.contiguous();
  const TrajectoryRows seeds = DrawSeeds(
      Eigen::Map<const TrajectoryRows>(dense.data_ptr<float>(), dense.size(0), dense.size(1)),
      actions, seed);
  at::Tensor means = at::empty({actions, dense.size(1)});
  std::copy(seeds.data(), seeds.data() + seeds.size(), means.data_ptr<float>());
  return means;
}

// Expectation maximisation on the encodings, each with its own variance.
PlacedMixture Fit(PlacedMixture mixture, const Gaussian& q_z) {
  const Gaussian each{q_z.mean.unsqueeze(1), q_z.log_variance.unsqueeze(1)};
  for (int i = 0; i < kFitIterations; ++i) {
    const at::Tensor r =
        at::softmax(mixture.log_weights - CrossEntropy(each, mixture.components), 1);  // [N, K]
    const at::Tensor counts = r.sum(0).clamp_min(1e-3).unsqueeze(1);
    const at::Tensor mean = at::matmul(r.t(), q_z.mean) / counts;
    const at::Tensor square =
        at::matmul(r.t(), q_z.mean.square() + q_z.log_variance.exp()) / counts;
    mixture.components = {mean, (square - mean.square()).clamp_min(kSmallestVariance).log()};
    mixture.log_weights = at::log_softmax(counts.squeeze(1).log(), 0);
  }
  return mixture;
}

at::Tensor Centers(const TrajectoryClusters& clusters) {
  at::Tensor centers = at::empty({clusters.centers.rows(), clusters.centers.cols()});
  std::copy(clusters.centers.data(), clusters.centers.data() + clusters.centers.size(),
            centers.data_ptr<float>());
  return centers;
}

}  // namespace

TrajectoryScale ScaleOf(const v1::TrainingSettings& settings) {
  return {artifact::WaypointInterval(settings.model().trajectory()),
          settings.optimization().slow_speed()};
}

at::Tensor ClusterSpace(v1::MixturePlacement placement, const at::Tensor& trajectories,
                        const TrajectoryScale& scale) {
  switch (placement) {
    case v1::MIXTURE_PLACEMENT_VELOCITY_CLUSTERS:
      return VelocitySpace(trajectories, scale);
    case v1::MIXTURE_PLACEMENT_DEPARTURE_CLUSTERS:
      return DepartureSpace(trajectories, scale);
    default:
      return PositionSpace(trajectories);
  }
}

at::Tensor NearestClusters(v1::MixturePlacement placement, const at::Tensor& centers,
                           const at::Tensor& trajectories, const TrajectoryScale& scale) {
  return at::cdist(ClusterSpace(placement, trajectories, scale), centers).argmin(1);
}

PlacedMixture PlaceMixture(v1::MixturePlacement placement, const EncodedExamples& examples,
                           int actions, uint64_t seed) {
  at::NoGradGuard no_grad;
  const Gaussian& q_z = examples.q_z;
  const int64_t dimensions = q_z.mean.size(1);
  at::Generator generator = MakeGenerator(seed);
  switch (placement) {
    case v1::MIXTURE_PLACEMENT_RANDOM:
      return {{at::empty({actions, dimensions}).normal_(0.0, 1.0, generator),
               at::zeros({actions, dimensions})},
              EvenWeights(actions)};
    case v1::MIXTURE_PLACEMENT_UNIFORM: {
      const at::Tensor low = q_z.mean.amin(0);
      const at::Tensor extent = q_z.mean.amax(0) - low;
      const at::Tensor means =
          low + extent * at::empty({actions, dimensions}).uniform_(0.0, 1.0, generator);
      const at::Tensor variance = (extent.square() / 12.0 * ShareOfVariance(actions, dimensions))
                                      .clamp_min(kSmallestVariance);
      return {{means, variance.log().expand_as(means).clone()}, EvenWeights(actions)};
    }
    case v1::MIXTURE_PLACEMENT_ENCODED_POINTS:
      return PlacedAt(
          q_z.mean.index_select(
              0, at::randperm(q_z.mean.size(0), generator, at::kLong).slice(0, 0, actions)),
          q_z);
    case v1::MIXTURE_PLACEMENT_ENCODED_SEEDS:
      return PlacedAt(Seeds(q_z, actions, seed), q_z);
    case v1::MIXTURE_PLACEMENT_FITTED_MIXTURE:
      return Fit(PlacedAt(Seeds(q_z, actions, seed), q_z), q_z);
    default: {
      const TrajectoryClusters clusters =
          Cluster(ClusterSpace(placement, examples.trajectories, examples.scale), actions, seed,
                  kClusterRestarts);
      PlacedMixture placed = PlacedByClusters(clusters.assignment, q_z, actions);
      placed.centers = Centers(clusters);
      return placed;
    }
  }
}

PlacedMixture PlaceLabelledMixture(v1::MixturePlacement placement, const EncodedExamples& examples,
                                   const std::vector<int>& labels, int labelled, int actions,
                                   uint64_t seed) {
  at::NoGradGuard no_grad;
  const at::Tensor label = at::tensor(at::ArrayRef<int>(labels), at::kLong);
  const at::Tensor known = (label >= 0).nonzero().flatten();
  const at::Tensor unknown = (label < 0).nonzero().flatten();
  if (labelled == 0 || known.size(0) == 0) return PlaceMixture(placement, examples, actions, seed);
  std::vector<int> known_labels;
  for (const int value : labels) {
    if (value >= 0) known_labels.push_back(value);
  }
  PlacedMixture placed = PlacedByClusters(known_labels, Rows(examples.q_z, known), labelled);
  if (labelled == actions) return placed;
  const at::Tensor others =
      unknown.size(0) < actions ? at::arange(label.size(0), at::kLong) : unknown;
  const PlacedMixture rest = PlaceMixture(
      placement,
      {examples.trajectories.index_select(0, others), examples.scale, Rows(examples.q_z, others)},
      actions - labelled, seed);
  return {{at::cat({placed.components.mean, rest.components.mean}),
           at::cat({placed.components.log_variance, rest.components.log_variance})},
          EvenWeights(actions),
          rest.centers};
}

}  // namespace maneuver::learning
