#include "model/learning/scene_covariance.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "model/artifact/model_spec.h"
#include "model/learning/covariance_fit.h"
#include "model/learning/moments.h"
#include "model/learning/optimizer.h"
#include "model/learning/scene_bound.h"

namespace maneuver::learning {
namespace {

constexpr double kWindow = 0.2;      // seconds to either side
constexpr double kLeastSpeed = 0.5;  // m/s
constexpr int kFactorSteps = 60;
constexpr double kFactorRate = 0.1;
// How many examples a bin's factors are drawn to the others' by, and how many it takes to widen a
// bin by itself. Examples of one recording are alike: 300 are worth about a dozen recordings.
constexpr double kPriorExamples = 300.0;
constexpr int64_t kFewestInBin = 300;

double Interval(const v1::ModelSpec& spec) {
  return artifact::WaypointTimes(spec.trajectory()).front();
}

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
  const at::Tensor u = MeanDirections(absolute, Interval(networks.spec()));
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
    q_y = Responsibilities(networks, {trajectories, scenes, {}}, log_p_y, posterior).exp();
    const at::Tensor means =
        networks.Decode(posterior.mean, networks.MeanResidual(scenes)).unflatten(2, {-1, 2});
    const at::Tensor u = MeanDirections(means + references.view({references.size(0), 1, -1, 2}),
                                        Interval(networks.spec()));
    const at::Tensor e = trajectories.view({trajectories.size(0), 1, -1, 2}) - means;
    const at::Tensor along = (e * u).sum(3);
    const at::Tensor across = e.select(3, 1) * u.select(3, 0) - e.select(3, 0) * u.select(3, 1);
    errors = at::stack({along, across}, 3);
  }
  const at::Tensor log_stddevs = networks.PredictLogStddevs(scenes);
  const at::Tensor costs = 0.5 * (errors * (-log_stddevs).exp()).square() + log_stddevs;
  return (q_y * costs.sum(3).mean(2)).sum(1);
}

at::Tensor SpeedBins(const at::Tensor& speeds) {
  at::Tensor bins = at::zeros(speeds.sizes(), speeds.options().dtype(at::kLong));
  for (const double bound : artifact::kSpeedBins) bins += (speeds.abs() >= bound).to(at::kLong);
  return bins;
}

at::Tensor WithSpeedFactors(const Predictions& predictions, const at::Tensor& factors) {
  const at::Tensor of_example = factors.index_select(0, SpeedBins(predictions.speeds));  // [N, 2]
  return predictions.along * of_example.select(1, 0).view({-1, 1, 1, 1}) +
         predictions.across * of_example.select(1, 1).view({-1, 1, 1, 1});
}

at::Tensor FitSpeedFactors(const Predictions& held_out) {
  const double examples = static_cast<double>(held_out.trajectories.size(0));
  at::Tensor logs = at::zeros({artifact::kSpeedBinCount, 2}, held_out.along.options());
  logs.set_requires_grad(true);
  AdamW optimizer;
  optimizer.Add({logs}, kFactorRate, 0.0);
  for (int step = 0; step < kFactorSteps; ++step) {
    const at::Tensor nll =
        -WaypointLogLikelihood(held_out.log_probabilities, held_out.mean,
                               held_out.covariance + WithSpeedFactors(held_out, logs.exp()),
                               held_out.trajectories)
             .mean();
    const at::Tensor spread = (logs - logs.mean(0, /*keepdim=*/true)).square().sum();
    (nll + 0.5 * kPriorExamples / examples * spread).backward();
    optimizer.Step(LearningRateShare(step, 0, kFactorSteps));
  }
  return logs.exp().detach();
}

at::Tensor WidenToCoverBySpeed(const Predictions& held_out, const at::Tensor& factors,
                               double share) {
  at::NoGradGuard no_grad;
  const at::Tensor bins = SpeedBins(held_out.speeds);
  const at::Tensor covariance = WithSpeedFactors(held_out, factors);
  const double of_all = WidenToCover(held_out, covariance, share);
  at::Tensor widened = factors.clone();
  for (int64_t bin = 0; bin < artifact::kSpeedBinCount; ++bin) {
    const at::Tensor rows = (bins == bin).nonzero().flatten();
    widened[bin].mul_(
        rows.size(0) < kFewestInBin
            ? of_all
            : WidenToCover(held_out.Rows(rows), covariance.index_select(0, rows), share));
  }
  return widened;
}

}  // namespace maneuver::learning
