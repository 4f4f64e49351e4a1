#include "model/learning/phases/pretrain.h"

#include "model/learning/gaussian.h"
#include "model/learning/objectives.h"
#include "model/learning/phases/trajectory_phase.h"

namespace maneuver::learning {

absl::Status Pretrain(LearningState& state, EpochLoop& loop) {
  const v1::ModelSpec& spec = state.settings.model();
  const Gaussian prior = StandardNormal(spec.latent_dimensions(), state.networks.device());
  TrajectoryPhase phase;
  phase.name = kPretrainPhase;
  phase.epochs = state.settings.optimization().pretraining_epochs();
  phase.parts = {Networks::Part::kTrajectoryEncoder, Networks::Part::kDecoder};
  phase.loss = [&](const TrajectoryBatch& batch, const StepContext& context, TermMeans* means) {
    const at::Tensor& x = batch.trajectories;
    const Gaussian q_z = state.networks.EncodeTrajectories(x);
    const at::Tensor z = Sample(q_z, state.Noise(q_z.mean.sizes()));
    const at::Tensor reconstruction =
        LogLikelihood(x, state.networks.Decode(z), spec.decoder_stddev());
    const at::Tensor divergence = Divergence(q_z, prior);
    means->Add("reconstruction", reconstruction, x.size(0));
    means->Add("latent_divergence", divergence, x.size(0));
    return (context.divergence_share * divergence - reconstruction).mean();
  };
  return LearnFromTrajectories(phase, state, loop);
}

}  // namespace maneuver::learning
