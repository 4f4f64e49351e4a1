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

// ln q_y of the base model, whatever is known. [B, K]
at::Tensor UnlabelledResponsibilities(const BaseModel& model) {
  return BaseLogResponsibilities(model.log_p_y,
                                 CrossEntropy(PerExample(model.q_z), PerAction(model.p_z)));
}

// ln q_y of the base model, held fixed. [B, K]
at::Tensor FixedBaseResponsibilities(const BaseModel& model) {
  at::NoGradGuard held_fixed;
  return WithLabels(UnlabelledResponsibilities(model), model.labels);
}

// ln p(x'|z') for the sample of each action that is decoded. [B, n]
at::Tensor ReconstructEach(const BaseModel& model, const PosteriorBranch& posterior) {
  const at::Tensor x = model.trajectories.unsqueeze(1);
  return posterior.huber > 0.0
             ? RobustReconstruction(x, posterior.decoded, model.decoder_stddev, posterior.huber)
             : LogLikelihood(x, posterior.decoded, model.decoder_stddev);
}

void AddPosterior(const at::Tensor& reconstruction, const PosteriorBranch& posterior,
                  const at::Tensor& divergence, BoundTerms* terms) {
  at::Tensor log_q_y = terms->log_responsibilities;
  terms->posterior_divergence = ExpectOverActions(log_q_y, divergence);
  if (posterior.actions.defined()) {
    log_q_y = at::log_softmax(log_q_y.gather(1, posterior.actions), 1);
  }
  terms->posterior_reconstruction = ExpectOverActions(log_q_y, reconstruction);
}

}  // namespace

at::Tensor LogLikelihood(const at::Tensor& trajectories, const at::Tensor& decoded, double stddev) {
  const double coordinates = static_cast<double>(trajectories.size(-1));
  const double normalizer =
      coordinates * (0.5 * std::log(2.0 * std::numbers::pi) + std::log(stddev));
  return (trajectories - decoded).square().sum(-1) * (-0.5 / (stddev * stddev)) - normalizer;
}

at::Tensor RobustReconstruction(const at::Tensor& trajectories, const at::Tensor& decoded,
                                double stddev, double huber) {
  const at::Tensor squares =
      (trajectories - decoded).unflatten(-1, {-1, 2}).square().sum(-1);  // [..., T]
  const double squared_huber = huber * huber;
  return ((1.0 + squares / squared_huber).sqrt() - 1.0).sum(-1) *
         (-squared_huber / (stddev * stddev));
}

at::Tensor BaseLogResponsibilities(const at::Tensor& log_p_y, const at::Tensor& cross_entropy) {
  return at::log_softmax(log_p_y - cross_entropy, 1);
}

at::Tensor UnifiedLogResponsibilities(const at::Tensor& log_p_y, const at::Tensor& cross_entropy,
                                      const at::Tensor& posterior_divergence) {
  return at::log_softmax(log_p_y - cross_entropy - posterior_divergence, 1);
}

at::Tensor ExactLogResponsibilities(const at::Tensor& log_p_y, const at::Tensor& cross_entropy,
                                    const at::Tensor& posterior_reconstruction,
                                    const at::Tensor& posterior_divergence) {
  return at::log_softmax(log_p_y - cross_entropy + posterior_reconstruction - posterior_divergence,
                         1);
}

at::Tensor WithLabels(const at::Tensor& log_q_y, const at::Tensor& labels) {
  if (!labels.defined()) return log_q_y;
  // e^-1e4 is 0, and 0 times its logarithm is still a number.
  constexpr double kLogOfNothing = -1e4;
  const at::Tensor one_hot =
      at::full_like(log_q_y, kLogOfNothing).scatter(1, labels.clamp_min(0).unsqueeze(1), 0.0);
  return at::where((labels >= 0).unsqueeze(1), one_hot, log_q_y);
}

at::Tensor ActionDivergence(const at::Tensor& log_q_y, const at::Tensor& log_p_y) {
  return (log_q_y.exp() * (log_q_y - log_p_y)).sum(1);
}

at::Tensor ExpectOverActions(const at::Tensor& log_q_y, const at::Tensor& values) {
  return (log_q_y.exp() * values).sum(1);
}

BoundTerms BaseBound(const BaseModel& model) {
  return BaseTerms(model, FixedBaseResponsibilities(model));
}

at::Tensor HeldCrossEntropy(const BaseModel& model) {
  return -UnlabelledResponsibilities(model).gather(1, model.labels.unsqueeze(1)).squeeze(1);
}

BoundTerms DualBound(const BaseModel& model, const PosteriorBranch& posterior) {
  BoundTerms terms;
  terms.log_responsibilities = FixedBaseResponsibilities(model);
  AddPosterior(ReconstructEach(model, posterior), posterior,
               Divergence(posterior.q_z, PerAction(model.p_z)), &terms);
  return terms;
}

BoundTerms UnifiedBound(const BaseModel& model, const PosteriorBranch& posterior,
                        double exact_weight) {
  const at::Tensor divergence = Divergence(posterior.q_z, PerAction(model.p_z));  // [B, K]
  const at::Tensor reconstruction = ReconstructEach(model, posterior);            // [B, n]
  at::Tensor log_q_y;
  {
    at::NoGradGuard held_fixed;
    const at::Tensor cross_entropy = CrossEntropy(PerExample(model.q_z), PerAction(model.p_z));
    log_q_y = exact_weight > 0.0
                  ? ExactLogResponsibilities(model.log_p_y, cross_entropy,
                                             exact_weight * reconstruction, divergence)
                  : UnifiedLogResponsibilities(model.log_p_y, cross_entropy, divergence);
    log_q_y = WithLabels(log_q_y, model.labels);
  }
  BoundTerms terms = BaseTerms(model, log_q_y);
  AddPosterior(reconstruction, posterior, divergence, &terms);
  return terms;
}

at::Tensor Loss(const BoundTerms& terms, const BoundWeights& weights) {
  at::Tensor loss = at::zeros_like(terms.log_responsibilities.select(1, 0));
  if (terms.reconstruction.defined()) {
    loss = loss - terms.reconstruction + weights.latent_divergence * terms.latent_divergence +
           weights.action * terms.action_divergence;
  }
  if (terms.posterior_reconstruction.defined()) {
    loss = loss - weights.posterior_reconstruction * terms.posterior_reconstruction +
           weights.posterior_divergence * terms.posterior_divergence;
  }
  return loss.mean();
}

}  // namespace maneuver::learning
