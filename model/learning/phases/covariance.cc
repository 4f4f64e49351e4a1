#include "model/learning/phases/covariance.h"

#include "model/learning/phases/scene_phase.h"
#include "model/learning/scene_covariance.h"

namespace maneuver::learning {

absl::Status TrainCovariance(LearningState& state, EpochLoop& loop) {
  constexpr double kLearningRate = 4e-3;
  if (!state.settings.model().has_scene_covariance()) return absl::OkStatus();
  ScenePhase phase;
  phase.name = kCovariancePhase;
  phase.epochs = state.settings.optimization().covariance_epochs();
  phase.parts = {{Networks::Part::kSceneCovariance, kLearningRate}};
  phase.loss = [&state](const SceneBatch& batch, const SceneTensors& inputs, const StepContext&,
                        TermMeans*) {
    return SceneCovarianceLoss(state.networks, batch.scenes, batch.trajectories,
                               inputs.references.to(state.networks.device()))
        .mean();
  };
  return LearnFromScenes(phase, state, loop);
}

}  // namespace maneuver::learning
