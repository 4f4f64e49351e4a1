// Runs phases that learn from scenes.

#ifndef MANEUVER_MODEL_LEARNING_PHASES_SCENE_PHASE_H_
#define MANEUVER_MODEL_LEARNING_PHASES_SCENE_PHASE_H_

#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"
#include "model/learning/scene_bound.h"
#include "model/learning/scene_tensors.h"

namespace maneuver::learning {

// A part of the networks that learns, and how fast.
struct LearningPart {
  Networks::Part part;
  double rate;
};

struct ScenePhase {
  std::string name;
  int epochs = 0;
  // Batch normalisation follows the batches, and dropout applies, if kScene is among them.
  std::vector<LearningPart> parts;
  // Returns the loss of a batch, and adds its terms to `means`.
  //   inputs: from which the features of the batch were computed
  std::function<at::Tensor(const SceneBatch& batch, const SceneTensors& inputs,
                           const StepContext& context, TermMeans* means)>
      loss;
  // Adds the results of held-out examples after an epoch.
  std::function<void(v1::EpochReport* report)> validate;
};

// Runs the phase. Errors are those of EpochLoop::Run.
absl::Status LearnFromScenes(const ScenePhase& phase, LearningState& state, EpochLoop& loop);

// Learns by maximising the bound of `objective`, and validates by it.
absl::Status MaximizeBound(const std::string& name, int epochs, v1::Objective objective,
                           Learning learning, const std::vector<LearningPart>& parts,
                           LearningState& state, EpochLoop& loop);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_SCENE_PHASE_H_
