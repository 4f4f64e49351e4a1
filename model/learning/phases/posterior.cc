#include "model/learning/phases/posterior.h"

#include "model/learning/phases/scene_phase.h"

namespace maneuver::learning {

absl::Status TrainScenarioEncoders(LearningState& state, EpochLoop& loop) {
  const v1::OptimizationSettings& optimization = state.settings.optimization();
  const v1::Objective objective = state.settings.model().objective();
  if (objective == v1::OBJECTIVE_BASE) {
    state.networks.ZeroScenarioEncoders();
    return absl::OkStatus();
  }
  return MaximizeBound(
      kPosteriorPhase, optimization.posterior_epochs(), objective, Learning::kPosterior,
      {{Networks::Part::kScenarioEncoder, optimization.learning_rate()}}, state, loop);
}

}  // namespace maneuver::learning
