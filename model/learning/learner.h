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
#include "model/learning/run_progress.h"

namespace maneuver::learning {

class Learner {
 public:
  // `settings` are complete. `data` and `progress` must outlive the learner.
  //   threads: that read maps and scenes
  //   ranks: must outlive the learner
  Learner(const v1::TrainingSettings& settings, const TrainingData& data, at::Device device,
          int threads, RankGroup& ranks, RunProgress& progress);

  // Returns the plan of a run, for its RunProgress.
  //   examples_in_memory: of training, which the phases on trajectories and calibration are over
  //   held_out_examples: in memory
  //   started: from the weights of a model
  static std::vector<RunProgress::Phase> Plan(const v1::TrainingSettings& settings,
                                              int64_t training_examples, int64_t examples_in_memory,
                                              int64_t held_out_examples, bool started = false);

  // Starts from these weights, which must have the same spec, instead of random ones. Learn then
  // begins with the joint phase. Call it first.
  //   sha256: of the weights; it identifies checkpoints of this run
  void StartFrom(const artifact::TensorMap& weights, const std::string& sha256);

  // Writes checkpoints to `folder`, which must outlive the learner, and resumes from its latest
  // one, if any. FAILED_PRECONDITION if that belongs to another run. For rank 0 alone.
  absl::Status KeepCheckpoints(CheckpointFolder* folder);

  // Runs all phases up to calibration, from the position of the checkpoint. Phases that learn from
  // scenes are run by all ranks, the others by rank 0. Only rank 0 has the calibrated model
  // afterwards. Before that, a process that learns alone measures what a step of each phase will
  // take (phases/rehearsal.h), so that the time left is right from the start. Errors are those of
  // EpochLoop::Run.
  absl::Status Learn();

  LearningState& state() { return state_; }
  EpochLoop& loop() { return loop_; }

 private:
  // Replaces the plan's costs by what steps take here.
  void Rehearse();

  LearningState state_;
  EpochLoop loop_;
  bool has_start_ = false;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_LEARNER_H_
