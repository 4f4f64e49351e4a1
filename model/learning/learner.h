// Runs all phases of learning, one after another, on the same networks.

#ifndef MANEUVER_MODEL_LEARNING_LEARNER_H_
#define MANEUVER_MODEL_LEARNING_LEARNER_H_

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/artifact/tensor.h"
#include "model/learning/checkpoint.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"
#include "model/learning/phases/rehearsal.h"
#include "model/learning/run_examples.h"
#include "model/learning/training_progress.h"

namespace maneuver::learning {

// The phases after the learner's in its plan. `evaluate` measures in kEvaluateSteps steps; one more
// step, of another kind, makes the report and completes the model.
inline constexpr char kExportPhase[] = "export";
inline constexpr char kEvaluatePhase[] = "evaluate";
inline constexpr int kEvaluateSteps = 100;

class Learner {
 public:
  //   settings: complete (artifact::ResolveTrainingSettings)
  //   data, ranks, progress: must outlive the learner
  //   threads: number of threads that read maps and scenes
  Learner(const v1::TrainingSettings& settings, const TrainingData& data, at::Device device,
          int threads, RankGroup& ranks, TrainingProgress& progress);

  // Returns the plan of a run, for its TrainingProgress.
  //   started: whether the run starts from the weights of a model
  static std::vector<TrainingProgress::Phase> Plan(const v1::TrainingSettings& settings,
                                                   const RunExamples& examples,
                                                   bool started = false);

  // Starts from these weights, which must have the same spec, instead of random ones. Learn then
  // begins with the joint phase. Call it first.
  //   sha256: of the weights; it identifies checkpoints of this run
  void StartFrom(const artifact::TensorMap& weights, const std::string& sha256);

  // Writes checkpoints to `folder`, which must outlive the learner, and resumes from its latest
  // one, if any. FAILED_PRECONDITION if that belongs to another run. Only rank 0 calls it.
  absl::Status KeepCheckpoints(CheckpointFolder* folder);

  // Runs all phases up to calibration, from the position of the checkpoint. All ranks run the
  // phases that learn from scenes; rank 0 runs the others. Afterwards only rank 0 has the
  // calibrated model. Before the phases, rank 0 measures how long a step of each takes
  // (phases/rehearsal.h), so that the time left is right from the start. Errors are those of
  // EpochLoop::Run.
  //   later: phases that this process will run after these
  absl::Status Learn(const LaterPhases& later = {});

  LearningState& state() { return state_; }
  EpochLoop& loop() { return loop_; }

 private:
  // Replaces the costs in the plan by the measured durations of steps.
  void Rehearse(const LaterPhases& later);

  LearningState state_;
  EpochLoop loop_;
  bool has_start_ = false;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_LEARNER_H_
