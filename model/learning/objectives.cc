#include "model/learning/objectives.h"

#include <cmath>
#include <numbers>

namespace maneuver::learning {
namespace {

// p_z for every example and action, [1, K, D], and q_z, [B, 1, D], against each other.
Gaussian PerExample(const Gaussian& q) {
  return {q.mean.unsqueeze(1), q.log_variance.unsqueeze(1)};
}
Gaussian PerAction(const Gaussian& p) { return {p.mean.unsqueeze(0), p.log_variance.unsqueeze(0)}; }

BoundTerms BaseTerms(const BaseModel& model, const at::Tensor& log_q_y) {
  BoundTerms terms;
  terms.log_responsibilities = log_q_y;
  terms.reconstruction = LogLikelihood(model.trajectories, model.decoded, model.decoder_stddev);
  terms.action_divergence = ActionDivergence(log_q_y, model.log_p_y);
  terms.latent_divergence =
      ExpectOverActions(log_q_y, Divergence(PerExample(model.q_z), PerAction(model.p_z)));
  return terms;
}

}  // namespace

at::Tensor LogLikelihood(const at::Tensor& trajectories, const at::Tensor& decoded, double stddev) {
  const double coordinates = static_cast<double>(trajectories.size(-1));
  const double normalizer =
      coordinates * (0.5 * std::log(2.0 * std::numbers::pi) + std::log(stddev));
  return (trajectories - decoded).square().sum(-1) * (-0.5 / (stddev * stddev)) - normalizer;
}

at::Tensor BaseLogResponsibilities(const at::Tensor& log_p_y, const at::Tensor& cross_entropy) {
  return at::log_softmax(log_p_y - cross_entropy, 1);
}

at::Tensor UnifiedLogResponsibilities(const at::Tensor& log_p_y, const at::Tensor& cross_entropy,
                                      const at::Tensor& posterior_divergence) {
  return at::log_softmax(log_p_y - cross_entropy - posterior_divergence, 1);
}

at::Tensor ActionDivergence(const at::Tensor& log_q_y, const at::Tensor& log_p_y) {
  return (log_q_y.exp() * (log_q_y - log_p_y)).sum(1);
}

at::Tensor ExpectOverActions(const at::Tensor& log_q_y, const at::Tensor& values) {
  return (log_q_y.exp() * values).sum(1);
}

BoundTerms BaseBound(const BaseModel& model) {
  at::Tensor log_q_y;
  {
    at::NoGradGuard held_fixed;
    log_q_y = BaseLogResponsibilities(model.log_p_y,
                                      CrossEntropy(PerExample(model.q_z), PerAction(model.p_z)));
  }
  return BaseTerms(model, log_q_y);
}

BoundTerms UnifiedBound(const BaseModel& model, const PosteriorBranch& posterior) {
  const at::Tensor divergence = Divergence(posterior.q_z, PerAction(model.p_z));  // [B, K]
  at::Tensor log_q_y;
  {
    at::NoGradGuard held_fixed;
    log_q_y = UnifiedLogResponsibilities(
        model.log_p_y, CrossEntropy(PerExample(model.q_z), PerAction(model.p_z)), divergence);
  }
  BoundTerms terms = BaseTerms(model, log_q_y);
  terms.posterior_reconstruction = ExpectOverActions(
      log_q_y,
      LogLikelihood(model.trajectories.unsqueeze(1), posterior.decoded, model.decoder_stddev));
  terms.posterior_divergence = ExpectOverActions(log_q_y, divergence);
  return terms;
}

at::Tensor Loss(const BoundTerms& terms, const BoundWeights& weights) {
  at::Tensor loss =
      -terms.reconstruction + terms.latent_divergence + weights.action * terms.action_divergence;
  if (terms.posterior_reconstruction.defined()) {
    loss = loss - weights.posterior_reconstruction * terms.posterior_reconstruction +
           weights.posterior_divergence * terms.posterior_divergence;
  }
  return loss.mean();
}

}  // namespace maneuver::learning
