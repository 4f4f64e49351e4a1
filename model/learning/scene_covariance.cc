#include "model/learning/scene_covariance.h"

#include <cmath>

#include "model/artifact/model_spec.h"
#include "model/learning/scene_bound.h"

namespace maneuver::learning {
namespace {

constexpr double kWindow = 0.2;      // seconds to either side
constexpr double kLeastSpeed = 0.5;  // m/s

// Sums over windows of `half` to either side along dimension 2, clipped at its ends.
at::Tensor WindowSums(const at::Tensor& values, int64_t half) {
  const int64_t count = values.size(2);
  const at::Tensor sums = values.cumsum(2);
  const at::Tensor index = at::arange(count, at::kLong).to(values.device());
  const at::Tensor upto = sums.index_select(2, (index + half).clamp_max(count - 1));
  const at::Tensor before =
      sums.index_select(2, (index - half - 1).clamp_min(0)) * (index > half).view({1, 1, count, 1});
  return upto - before;
}

}  // namespace

at::Tensor MeanDirections(const at::Tensor& means, double interval) {
  const int64_t half = std::lround(kWindow / interval);
  const at::Tensor start = at::zeros_like(means.slice(2, 0, 1));
  const at::Tensor steps = means - at::cat({start, means.slice(2, 0, -1)}, 2);
  const at::Tensor averages =
      WindowSums(steps, half) / WindowSums(at::ones_like(steps.slice(3, 0, 1)), half);
  const at::Tensor length = averages.norm(2, {3}, /*keepdim=*/true);
  const at::Tensor ahead = at::tensor({1.0, 0.0}, means.options());
  return at::where(length > kLeastSpeed * interval, averages / length.clamp_min(1e-9), ahead);
}

SplitCovariance PredictSceneCovariance(const Networks& networks, const SceneFeatures& scenes,
                                       const at::Tensor& means, const at::Tensor& references) {
  const at::Tensor absolute = means + references.view({references.size(0), 1, -1, 2});
  const at::Tensor u =
      MeanDirections(absolute, artifact::WaypointInterval(networks.spec().trajectory()));
  const at::Tensor variances = (2.0 * networks.PredictLogStddevs(scenes)).exp();  // [B, K, T, 2]
  const at::Tensor ux = u.select(3, 0), uy = u.select(3, 1);
  const at::Tensor products = at::stack({ux.square(), ux * uy, uy.square()}, 3);
  const at::Tensor across = at::stack({uy.square(), -ux * uy, ux.square()}, 3);
  return {variances.slice(3, 0, 1) * products, variances.slice(3, 1, 2) * across};
}

at::Tensor SceneCovarianceLoss(const Networks& networks, const SceneFeatures& scenes,
                               const at::Tensor& trajectories, const at::Tensor& references) {
  at::Tensor errors, q_y;
  {
    at::NoGradGuard held_fixed;
    const at::Tensor log_p_y = networks.PredictActions(scenes);
    const Gaussian posterior = networks.EncodeScenarios(scenes);
    q_y = LogResponsibilities(networks, {trajectories, scenes, {}}, log_p_y, posterior).exp();
    const at::Tensor means =
        networks.Decode(posterior.mean, networks.MeanResidual(scenes)).unflatten(2, {-1, 2});
    const at::Tensor u = MeanDirections(means + references.view({references.size(0), 1, -1, 2}),
                                        artifact::WaypointInterval(networks.spec().trajectory()));
    const at::Tensor e = trajectories.view({trajectories.size(0), 1, -1, 2}) - means;
    const at::Tensor along = (e * u).sum(3);
    const at::Tensor across = e.select(3, 1) * u.select(3, 0) - e.select(3, 0) * u.select(3, 1);
    errors = at::stack({along, across}, 3);
  }
  const at::Tensor log_stddevs = networks.PredictLogStddevs(scenes);
  const at::Tensor costs = 0.5 * (errors * (-log_stddevs).exp()).square() + log_stddevs;
  return (q_y * costs.sum(3).mean(2)).sum(1);
}

}  // namespace maneuver::learning
