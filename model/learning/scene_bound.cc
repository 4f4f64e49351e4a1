#include "model/learning/scene_bound.h"

namespace maneuver::learning {

BaseModel ApplyBase(const Networks& networks, const SceneBatch& batch, const NoiseSource& noise) {
  const Gaussian q_z = networks.EncodeTrajectories(batch.trajectories);
  BaseModel model;
  model.trajectories = batch.trajectories;
  model.decoded = networks.Decode(Sample(q_z, noise(q_z.mean.sizes())));
  model.q_z = q_z;
  model.p_z = networks.Mixture();
  model.log_p_y = batch.features.defined() ? networks.PredictActions(batch.features)
                                           : networks.MixtureLogWeights();
  model.decoder_stddev = networks.spec().decoder_stddev();
  model.labels = batch.labels;
  return model;
}

BoundTerms SceneBound(const Networks& networks, v1::Objective objective, Learning learning,
                      const v1::OptimizationSettings& optimization, const SceneBatch& batch,
                      const NoiseSource& noise) {
  if (objective == v1::OBJECTIVE_BASE) return BaseBound(ApplyBase(networks, batch, noise));
  const Gaussian q_z = networks.EncodeScenarios(batch.features);
  const PosteriorBranch posterior{networks.Decode(Sample(q_z, noise(q_z.mean.sizes()))), q_z};
  BaseModel base;
  {
    at::AutoGradMode learns(learning == Learning::kAll);
    base = ApplyBase(networks, batch, noise);
  }
  if (objective == v1::OBJECTIVE_DUAL) return DualBound(base, posterior);
  const bool exact = optimization.responsibilities() == v1::RESPONSIBILITIES_EXACT;
  return UnifiedBound(base, posterior,
                      exact ? optimization.posterior_reconstruction_weight() : 0.0);
}

at::Tensor Responsibilities(const Networks& networks, const SceneBatch& batch,
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
