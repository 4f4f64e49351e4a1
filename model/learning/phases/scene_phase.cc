#include "model/learning/phases/scene_phase.h"

#include <optional>

#include "model/learning/scene_loader.h"
#include "model/learning/validation.h"

namespace maneuver::learning {
namespace {

class SceneSteps final : public EpochSteps {
 public:
  SceneSteps(const ScenePhase& phase, bool scene_learns, LearningState& state)
      : phase_(phase),
        scene_learns_(scene_learns),
        state_(state),
        mode_{&state.generator, state.settings.optimization().dropout(),
              state.settings.optimization().geometry_dropout()} {}

  void BeginEpoch(std::span<const int64_t> order, int64_t first_step, int epoch) override {
    loader_.emplace(state_.settings.model(), state_.training,
                    EpochItems(state_.settings, order, first_step, epoch),
                    state_.settings.optimization().batch_size(), state_.threads);
  }

  BatchLoss Next(const Moment& moment, TermMeans* means) override {
    const SceneLoader::Batch batch = *loader_->Next();
    SceneBatch scenes;
    scenes.trajectories = batch.trajectories.to(state_.networks.device());
    scenes.labels = BatchLabels(state_.data.labels, batch);
    if (scene_learns_) {
      scenes.scenes = state_.networks.EncodeScenes(batch.scenes, mode_);
    } else {
      at::NoGradGuard no_grad;
      scenes.scenes = state_.networks.EncodeScenes(batch.scenes, {});
    }
    return {phase_.loss(scenes, batch.scenes, moment, means), scenes.trajectories.size(0),
            batch.waited};
  }

  void EndEpoch(v1::EpochReport* report) override {
    loader_.reset();
    if (phase_.validate) phase_.validate(report);
  }

 private:
  const ScenePhase& phase_;
  const bool scene_learns_;
  LearningState& state_;
  const Networks::Mode mode_;
  std::optional<SceneLoader> loader_;  // of the epoch
};

}  // namespace

absl::Status LearnFromScenes(const ScenePhase& phase, LearningState& state, EpochLoop& loop) {
  const v1::OptimizationSettings& optimization = state.settings.optimization();
  AdamW optimizer;
  bool scene_learns = false;
  for (const LearningPart& each : phase.parts) {
    optimizer.Add(state.networks.Parameters(each.part), each.rate, optimization.weight_decay());
    scene_learns |= each.part == Networks::Part::kScene;
  }
  SceneSteps steps(phase, scene_learns, state);
  return loop.Run(
      {phase.name, phase.epochs, optimization.batch_size()},
      {state.generator, optimizer, [&state](Checkpoint* checkpoint) { state.Store(checkpoint); }},
      steps);
}

absl::Status MaximizeBound(const std::string& name, int epochs, v1::Objective objective,
                           Learning learning, const std::vector<LearningPart>& parts,
                           LearningState& state, EpochLoop& loop) {
  const v1::OptimizationSettings& optimization = state.settings.optimization();
  const auto loss = [&](const SceneBatch& batch, const SceneTensors&, const Moment& moment,
                        TermMeans* means) {
    const BoundTerms terms =
        SceneBound(state.networks, objective, learning, optimization, batch, state.NoiseDrawn());
    means->Add(terms);
    return Loss(terms, Weights(optimization, moment.divergence_share));
  };
  const auto validate = [&](v1::EpochReport* report) {
    ValidateScenes(state.networks, state.validation, objective, optimization, state.threads,
                   state.stopped, report);
  };
  return LearnFromScenes({name, epochs, parts, loss, validate}, state, loop);
}

}  // namespace maneuver::learning
