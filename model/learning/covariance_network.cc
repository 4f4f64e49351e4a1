#include "model/learning/covariance_network.h"

#include <algorithm>
#include <string>

#include "model/artifact/model_spec.h"
#include "model/learning/moments.h"
#include "model/learning/optimizer.h"

namespace maneuver::learning {
namespace {

constexpr int kNetworkPasses = 40;
constexpr int64_t kNetworkBatch = 512;
constexpr double kNetworkRate = 1e-2;
constexpr double kNetworkDecay = 1e-3;
constexpr int64_t kNetworkWarmUp = 10;  // steps

std::string LastLayerOf(const Networks& networks) {
  return artifact::LastLayer("decoder_covariance", networks.spec().decoder_covariance());
}

// Its last layer answers `pooled` for every z.
void BeginAt(Networks& networks, const at::Tensor& pooled) {
  constexpr double kLeast = 0.01;  // square metres
  at::NoGradGuard no_grad;
  const at::Tensor l11 = pooled.select(-1, 0).clamp_min(kLeast).sqrt();
  const at::Tensor l21 = pooled.select(-1, 1) / l11;
  const at::Tensor l22 = (pooled.select(-1, 2) - l21.square()).clamp_min(kLeast).sqrt();
  networks[LastLayerOf(networks) + ".weight"].zero_();
  networks[LastLayerOf(networks) + ".bias"].copy_(
      at::stack({l11.log(), l22.log(), l21 / l22}, -1).flatten());
}

}  // namespace

void FitCovarianceNetwork(Networks& networks, const Predictions& predictions,
                          const at::Tensor& pooled, at::Generator& generator) {
  BeginAt(networks, pooled);
  const int64_t examples = predictions.trajectories.size(0);
  const int64_t steps = kNetworkPasses * BatchesOf(examples, kNetworkBatch);
  AdamW optimizer;
  optimizer.Add(networks.Parameters(Networks::Part::kDecoderCovariance), kNetworkRate,
                kNetworkDecay);
  for (int64_t step = 0; step < steps; ++step) {
    const at::Tensor rows =
        at::randint(examples, {std::min(examples, kNetworkBatch)}, generator, at::kLong)
            .to(networks.device());
    const Predictions batch = predictions.Rows(rows);
    const at::Tensor log_density = WaypointLogDensities(
        batch.mean, batch.covariance + networks.PredictCovariance(batch.latents),
        batch.trajectories);
    (-(batch.log_responsibilities.exp() * log_density.mean(2)).sum(1).mean()).backward();
    optimizer.Step(LearningRateShare(step, kNetworkWarmUp, steps));
    batch.CountStep(CalibrationStep::kFit);
  }
}

PlannedSteps CovarianceNetworkSteps(int64_t examples) {
  return {kNetworkPasses * BatchesOf(examples, kNetworkBatch), std::min(examples, kNetworkBatch)};
}

void ScaleCovarianceNetwork(Networks& networks, const at::Tensor& factor) {
  at::NoGradGuard no_grad;
  at::Tensor bias = networks[LastLayerOf(networks) + ".bias"].view({-1, 3});
  const at::Tensor shift = 0.5 * factor.log();
  bias.select(1, 0).add_(shift);
  bias.select(1, 1).add_(shift);
}

}  // namespace maneuver::learning
