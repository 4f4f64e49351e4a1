#include "model/learning/phases/scene_phase.h"

#include "model/learning/phases/scene_batches.h"
#include "model/learning/validation.h"

namespace maneuver::learning {
namespace {

class SceneSteps final : public EpochSteps {
 public:
  SceneSteps(const ScenePhase& phase, bool scene_learns, const MicroBatchRange& range,
             LearningState& state)
      : phase_(phase),
        scene_learns_(scene_learns),
        state_(state),
        batches_(state.settings.model(), state, range),
        mode_{&state.generator, state.settings.optimization().dropout(),
              state.settings.optimization().geometry_dropout()} {}

  absl::Status BeginEpoch(const EpochStart& start) override { return batches_.BeginEpoch(start); }

  absl::StatusOr<BatchLoss> Next(const StepContext& context, TermMeans* means) override {
    const absl::StatusOr<SceneBatches::LabelledBatch> next = batches_.Next();
    if (!next.ok()) return next.status();
    const SceneLoader::Batch& batch = next->batch;
    if (batch.items.empty()) return BatchLoss{};
    SceneBatch scenes;
    scenes.trajectories = batch.trajectories.to(state_.networks.device());
    if (next->labels.defined()) scenes.labels = next->labels.to(state_.networks.device());
    if (scene_learns_) {
      scenes.scenes = state_.networks.EncodeScenes(batch.scenes, mode_);
    } else {
      at::NoGradGuard no_grad;
      scenes.scenes = state_.networks.EncodeScenes(batch.scenes, {});
    }
    return BatchLoss{phase_.loss(scenes, batch.scenes, context, means), scenes.trajectories.size(0),
                     batch.waited, next->share};
  }

  void EndEpoch(v1::EpochReport* report) override {
    batches_.EndEpoch();
    if (report != nullptr && phase_.validate) phase_.validate(report);
  }

 private:
  const ScenePhase& phase_;
  const bool scene_learns_;
  LearningState& state_;
  SceneBatches batches_;
  const Networks::Mode mode_;
};

}  // namespace

absl::Status LearnFromScenes(const ScenePhase& phase, LearningState& state, EpochLoop& loop) {
  const v1::OptimizationSettings& optimization = state.settings.optimization();
  AdamW optimizer;
  bool scene_learns = false;
  for (const LearningPart& each : phase.parts) {
    optimizer.Add(state.networks.Parameters(each.part), state.networks.Decays(each.part), each.rate,
                  optimization.weight_decay());
    scene_learns |= each.part == Networks::Part::kScene;
  }
  SceneSteps steps(phase, scene_learns, loop.micro_batches(), state);
  PhasePlan plan;
  plan.name = phase.name;
  plan.epochs = phase.epochs;
  plan.batch_size = optimization.batch_size();
  plan.examples = state.data.TrainingExamples();
  plan.together = true;
  return loop.Run(
      plan,
      {state.generator, optimizer, [&state](Checkpoint* checkpoint) { state.Store(checkpoint); },
       [&state](const Checkpoint& checkpoint) { state.Restore(checkpoint); },
       state.networks.RunningMoments()},
      steps);
}

absl::Status MaximizeBound(const std::string& name, int epochs, v1::Objective objective,
                           Learning learning, const std::vector<LearningPart>& parts,
                           LearningState& state, EpochLoop& loop) {
  const v1::OptimizationSettings& optimization = state.settings.optimization();
  const auto loss = [&](const SceneBatch& batch, const SceneTensors&, const StepContext& context,
                        TermMeans* means) {
    const BoundTerms terms =
        SceneBound(state.networks, objective, learning, optimization, batch, state.NoiseDrawn());
    means->Add(terms);
    return Loss(terms, Weights(optimization, context.divergence_share));
  };
  const auto validate = [&](v1::EpochReport* report) {
    ValidateScenes(state.networks, state.validation, objective, optimization, state.threads,
                   state.stopped, report);
  };
  return LearnFromScenes({name, epochs, parts, loss, validate}, state, loop);
}

}  // namespace maneuver::learning
