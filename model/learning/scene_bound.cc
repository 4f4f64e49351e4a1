#include "model/learning/scene_bound.h"

namespace maneuver::learning {

BaseModel ApplyBase(const Networks& networks, const SceneBatch& batch, const NoiseSource& noise) {
  const Gaussian q_z = networks.EncodeTrajectories(batch.trajectories);
  BaseModel model;
  model.trajectories = batch.trajectories;
  model.decoded = networks.Decode(Sample(q_z, noise(q_z.mean.sizes())));
  model.q_z = q_z;
  model.p_z = networks.Mixture();
  model.log_p_y = batch.scenes.features.defined() ? networks.PredictActions(batch.scenes)
                                                  : networks.MixtureLogWeights();
  model.decoder_stddev = networks.spec().decoder_stddev();
  model.labels = batch.labels;
  return model;
}

namespace {

// [B, K, C] -> [B, n, C], of the actions [B, n].
at::Tensor OfActions(const at::Tensor& values, const at::Tensor& actions) {
  return values.gather(1, actions.unsqueeze(2).expand({-1, -1, values.size(2)}));
}

// The samples of q(z|y,s) decoded: of all actions, or of those with the largest q(y|x,s). Exact
// responsibilities of the unified model contain the reconstruction by each action, so they need all.
PosteriorBranch DecodePosterior(const Networks& networks, v1::Objective objective,
                                const v1::OptimizationSettings& optimization,
                                const SceneBatch& batch, const BaseModel& base, const Gaussian& q_z,
                                const NoiseSource& noise) {
  PosteriorBranch posterior{.decoded = {}, .q_z = q_z};
  posterior.huber = optimization.posterior_huber();
  at::Tensor residual = networks.MeanResidual(batch.scenes);
  Gaussian decoded = q_z;
  const bool needs_all = objective == v1::OBJECTIVE_UNIFIED &&
                         optimization.responsibilities() == v1::RESPONSIBILITIES_EXACT;
  const int64_t count = needs_all ? 0 : optimization.posterior_actions();
  if (count > 0 && count < q_z.mean.size(1)) {
    at::NoGradGuard held_fixed;
    const Gaussian q_x{base.q_z.mean.unsqueeze(1), base.q_z.log_variance.unsqueeze(1)};
    const Gaussian p_z{base.p_z.mean.unsqueeze(0), base.p_z.log_variance.unsqueeze(0)};
    const at::Tensor cross_entropy = CrossEntropy(q_x, p_z);
    const at::Tensor log_q_y =
        objective == v1::OBJECTIVE_UNIFIED
            ? UnifiedLogResponsibilities(base.log_p_y, cross_entropy, Divergence(q_z, p_z))
            : BaseLogResponsibilities(base.log_p_y, cross_entropy);
    posterior.actions = std::get<1>(WithLabels(log_q_y, base.labels).topk(count, 1));
  }
  if (posterior.actions.defined()) {
    decoded = {OfActions(q_z.mean, posterior.actions),
               OfActions(q_z.log_variance, posterior.actions)};
    if (residual.defined()) residual = OfActions(residual, posterior.actions);
  }
  posterior.decoded = networks.Decode(Sample(decoded, noise(decoded.mean.sizes())), residual);
  return posterior;
}

}  // namespace

BoundTerms SceneBound(const Networks& networks, v1::Objective objective, Learning learning,
                      const v1::OptimizationSettings& optimization, const SceneBatch& batch,
                      const NoiseSource& noise) {
  if (objective == v1::OBJECTIVE_BASE) return BaseBound(ApplyBase(networks, batch, noise));
  const Gaussian q_z = networks.EncodeScenarios(batch.scenes);
  BaseModel base;
  {
    at::AutoGradMode learns(learning == Learning::kAll);
    base = ApplyBase(networks, batch, noise);
  }
  const PosteriorBranch posterior =
      DecodePosterior(networks, objective, optimization, batch, base, q_z, noise);
  if (objective == v1::OBJECTIVE_DUAL) return DualBound(base, posterior);
  const bool exact = optimization.responsibilities() == v1::RESPONSIBILITIES_EXACT;
  return UnifiedBound(base, posterior,
                      exact ? optimization.posterior_reconstruction_weight() : 0.0);
}

at::Tensor LogResponsibilities(const Networks& networks, const SceneBatch& batch,
                               const at::Tensor& log_p_y, const Gaussian& posterior) {
  const Gaussian q_z = networks.EncodeTrajectories(batch.trajectories);
  const Gaussian mixture = networks.Mixture();
  const at::Tensor cross_entropy =
      CrossEntropy({q_z.mean.unsqueeze(1), q_z.log_variance.unsqueeze(1)}, mixture);
  if (networks.spec().objective() != v1::OBJECTIVE_UNIFIED) {
    return BaseLogResponsibilities(log_p_y, cross_entropy);
  }
  return UnifiedLogResponsibilities(log_p_y, cross_entropy, Divergence(posterior, mixture));
}

BoundWeights Weights(const v1::OptimizationSettings& optimization, double share) {
  return {share * optimization.action_weight(), optimization.posterior_reconstruction_weight(),
          share * optimization.posterior_divergence_weight(), share};
}

}  // namespace maneuver::learning
