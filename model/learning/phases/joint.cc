#include "model/learning/phases/joint.h"

#include <vector>

#include "model/learning/phases/scene_phase.h"

namespace maneuver::learning {

absl::Status TrainJointly(LearningState& state, EpochLoop& loop) {
  using Part = Networks::Part;
  const v1::OptimizationSettings& optimization = state.settings.optimization();
  const double rate = optimization.learning_rate();
  const double latent_rate = rate * optimization.latent_learning_rate_share();
  std::vector<LearningPart> parts = {{Part::kScene, rate},
                                     {Part::kActions, rate},
                                     {Part::kTrajectoryEncoder, latent_rate},
                                     {Part::kDecoder, latent_rate},
                                     {Part::kMixture, latent_rate}};
  const bool unified = state.settings.model().objective() == v1::OBJECTIVE_UNIFIED;
  if (unified) parts.push_back({Part::kScenarioEncoder, rate});
  return MaximizeBound(kJointPhase, optimization.joint_epochs(),
                       unified ? v1::OBJECTIVE_UNIFIED : v1::OBJECTIVE_BASE, Learning::kAll, parts,
                       state, loop);
}

}  // namespace maneuver::learning
