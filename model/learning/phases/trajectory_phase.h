// Runs phases that learn only from trajectories.

#ifndef MANEUVER_MODEL_LEARNING_PHASES_TRAJECTORY_PHASE_H_
#define MANEUVER_MODEL_LEARNING_PHASES_TRAJECTORY_PHASE_H_

#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"

namespace maneuver::learning {

// What a step learns from.
struct TrajectoryBatch {
  at::Tensor trajectories;  // varied, x - r(m), [B, 2T] metres
  // The action of each that is known, -1 where it is not, [B]; undefined if there are no labels.
  // That of a mirrored trajectory is not known.
  at::Tensor labels;
};

struct TrajectoryPhase {
  std::string name;
  int epochs = 0;
  bool resumable = true;  // as in PhasePlan
  // Parts that learn, all at the settings' learning rate.
  std::vector<Networks::Part> parts;
  // Returns the loss of a batch, and adds its terms to `means`.
  std::function<at::Tensor(const TrajectoryBatch& batch, const StepContext& context,
                           TermMeans* means)>
      loss;
  // Whether the model has a mixture by now. Held-out trajectories are then validated with it.
  bool has_mixture = false;
  // Called with each epoch's report. May be empty.
  std::function<void(const v1::EpochReport& report)> report;
};

// Runs the phase on one thread: a batch is done before a second thread would wake up, and on a busy
// machine threads that wait for each other cost several times the work. Errors are those of
// EpochLoop::Run.
absl::Status LearnFromTrajectories(const TrajectoryPhase& phase, LearningState& state,
                                   EpochLoop& loop);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_TRAJECTORY_PHASE_H_
