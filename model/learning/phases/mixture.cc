#include "model/learning/phases/mixture.h"

#include <cmath>
#include <utility>

#include "model/learning/dirichlet_weights.h"
#include "model/learning/mixture_placement.h"
#include "model/learning/objectives.h"
#include "model/learning/phases/trajectory_phase.h"
#include "model/learning/scene_bound.h"

namespace maneuver::learning {
namespace {

constexpr double kCountRate = 0.02;  // of the mixture's counts, a batch

// alpha_0 + N_k of a mixture with a prior on its weights (dirichlet_weights.h). [K]
at::Tensor WeightCounts(const Networks& networks) {
  return networks["mixture.log_weight"].detach().exp();
}

// responsibilities: [B, K]
void FollowWeightCounts(const at::Tensor& responsibilities, LearningState& state) {
  at::NoGradGuard no_grad;
  state.networks["mixture.log_weight"].copy_(
      FollowCounts(WeightCounts(state.networks), responsibilities, state.observations,
                   state.settings.optimization().weight_concentration(), kCountRate)
          .log());
}

// The action of each trajectory: the known one, or else that of its cluster. [B]
at::Tensor ClusteredActions(const TrajectoryBatch& batch, const LearningState& state) {
  const int64_t first = state.settings.model().actions() - state.centers.size(0);
  const at::Tensor actions =
      first + NearestClusters(state.settings.optimization().mixture_placement(), state.centers,
                              batch.trajectories.cpu(), ScaleOf(state.settings))
                  .to(state.networks.device());
  return batch.labels.defined() ? at::where(batch.labels >= 0, batch.labels, actions) : actions;
}

at::Tensor MixtureLoss(const TrajectoryBatch& batch, const StepContext& context, int epochs,
                       LearningState& state, TermMeans* means) {
  const v1::OptimizationSettings& optimization = state.settings.optimization();
  const bool clustered =
      state.centers.defined() && context.epoch < optimization.clustered_share() * epochs;
  const at::Tensor labels = clustered ? ClusteredActions(batch, state) : batch.labels;
  BaseModel model = ApplyBase(state.networks, {batch.trajectories, {}, labels}, state.NoiseDrawn());
  const bool by_bayes = optimization.weight_concentration() > 0.0;
  if (by_bayes) model.log_p_y = ExpectedLogWeights(WeightCounts(state.networks));
  const BoundTerms terms = BaseBound(model);
  if (by_bayes) FollowWeightCounts(terms.log_responsibilities.exp(), state);
  means->Add(terms);
  BoundWeights weights;
  weights.action = weights.latent_divergence = context.divergence_share;
  const at::Tensor loss = Loss(terms, weights);
  const double cluster_weight = optimization.cluster_weight();
  if (cluster_weight <= 0.0 || !clustered) return loss;
  return loss + cluster_weight * HeldCrossEntropy(model).mean();
}

TrajectoryPhase MixturePhase(const std::string& name, int epochs, LearningState& state) {
  TrajectoryPhase phase;
  phase.name = name;
  phase.epochs = epochs;
  phase.parts = {Networks::Part::kTrajectoryEncoder, Networks::Part::kDecoder,
                 Networks::Part::kMixture};
  phase.loss = [&state, epochs](const TrajectoryBatch& batch, const StepContext& context,
                                TermMeans* means) {
    return MixtureLoss(batch, context, epochs, state, means);
  };
  phase.has_mixture = true;
  return phase;
}

}  // namespace

absl::Status TrainMixture(LearningState& state, EpochLoop& loop) {
  const v1::OptimizationSettings& optimization = state.settings.optimization();
  const absl::Status status = LearnFromTrajectories(
      MixturePhase(kMixturePhase, optimization.mixture_epochs(), state), state, loop);
  if (status.ok() && optimization.weight_concentration() > 0.0) {
    state.networks.SwitchOff(
        UnneededActions(WeightCounts(state.networks), optimization.weight_concentration()));
  }
  return status;
}

absl::StatusOr<double> TryMixture(const std::string& phase, int epochs, LearningState& state,
                                  EpochLoop& loop) {
  double loss = HUGE_VAL;
  TrajectoryPhase trial = MixturePhase(phase, epochs, state);
  trial.resumable = false;
  trial.report = [&loss](const v1::EpochReport& report) {
    const auto& terms = report.validation().empty() ? report.training() : report.validation();
    loss = terms.at("loss");
  };
  const absl::Status status = LearnFromTrajectories(trial, state, loop);
  if (!status.ok()) return status;
  return loss;
}

}  // namespace maneuver::learning
