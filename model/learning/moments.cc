#include "model/learning/moments.h"

#include <cmath>
#include <numbers>
#include <utility>

namespace maneuver::learning {

WaypointMoments LatentMoments(const Networks& networks, const Gaussian& latents,
                              const at::Tensor& residual) {
  const int64_t batch = latents.mean.size(0);
  const int64_t actions = latents.mean.size(1);
  const int64_t dimensions = latents.mean.size(2);
  const at::Tensor offsets = at::diag_embed((0.5 * latents.log_variance).exp());  // [B, K, D, D]
  const at::Tensor center = latents.mean.unsqueeze(2);                            // [B, K, 1, D]
  const at::Tensor points = at::cat({center, center + offsets, center - offsets}, 2);
  const at::Tensor decoded =
      networks.Decode(points, residual.defined() ? residual.unsqueeze(2) : residual)
          .view({batch, actions, 2 * dimensions + 1, -1, 2});
  // As probability/sigma_points.h has it: the mean with the second differences, the covariance from
  // the central ones.
  const at::Tensor middle = decoded.select(2, 0);               // [B, K, T, 2]
  const at::Tensor plus = decoded.slice(2, 1, 1 + dimensions);  // [B, K, D, T, 2]
  const at::Tensor minus = decoded.slice(2, 1 + dimensions);
  const at::Tensor deviation = 0.5 * (plus - minus);
  const at::Tensor dx = deviation.select(4, 0);
  const at::Tensor dy = deviation.select(4, 1);
  WaypointMoments moments;
  moments.mean = middle + 0.5 * (plus + minus).sum(2) - static_cast<double>(dimensions) * middle;
  moments.covariance = at::stack({dx.square().sum(2), (dx * dy).sum(2), dy.square().sum(2)}, -1);
  return moments;
}

namespace {

// Errors at each waypoint against their covariance: (e^T C^-1 e, det C), [B, K, T] both.
std::pair<at::Tensor, at::Tensor> DistanceAndDeterminant(const at::Tensor& mean,
                                                         const at::Tensor& covariance,
                                                         const at::Tensor& trajectories) {
  const at::Tensor truth = trajectories.view({trajectories.size(0), 1, -1, 2});
  const at::Tensor dx = truth.select(3, 0) - mean.select(3, 0);  // [B, K, T]
  const at::Tensor dy = truth.select(3, 1) - mean.select(3, 1);
  const at::Tensor xx = covariance.select(3, 0);
  const at::Tensor xy = covariance.select(3, 1);
  const at::Tensor yy = covariance.select(3, 2);
  const at::Tensor determinant = xx * yy - xy.square();
  const at::Tensor distance =
      (yy * dx.square() - 2.0 * xy * dx * dy + xx * dy.square()) / determinant;
  return {distance, determinant};
}

}  // namespace

at::Tensor SquaredDistances(const at::Tensor& mean, const at::Tensor& covariance,
                            const at::Tensor& trajectories) {
  return DistanceAndDeterminant(mean, covariance, trajectories).first;
}

at::Tensor WaypointLogDensities(const at::Tensor& mean, const at::Tensor& covariance,
                                const at::Tensor& trajectories) {
  const auto [distance, determinant] = DistanceAndDeterminant(mean, covariance, trajectories);
  return -0.5 * (distance + determinant.log()) - std::log(2.0 * std::numbers::pi);
}

at::Tensor WaypointLogLikelihood(const at::Tensor& log_probabilities, const at::Tensor& mean,
                                 const at::Tensor& covariance, const at::Tensor& trajectories) {
  return at::logsumexp(
      log_probabilities.unsqueeze(2) + WaypointLogDensities(mean, covariance, trajectories), {1});
}

}  // namespace maneuver::learning
