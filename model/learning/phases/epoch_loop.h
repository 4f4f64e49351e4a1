// The loop over epochs and steps that every phase learns in.

#ifndef MANEUVER_MODEL_LEARNING_PHASES_EPOCH_LOOP_H_
#define MANEUVER_MODEL_LEARNING_PHASES_EPOCH_LOOP_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/checkpoint.h"
#include "model/learning/optimizer.h"
#include "model/learning/phases/batch_loss.h"
#include "model/learning/ranks/micro_batch_range.h"
#include "model/learning/ranks/rank_group.h"
#include "model/learning/tensors.h"
#include "model/learning/training_data.h"
#include "model/learning/training_progress.h"
#include "model/learning/validation.h"

namespace maneuver::learning {

// The position of a step in its phase.
struct StepContext {
  int epoch = 0;  // epochs before this one
  // Factor of the weights of the divergences: rises from 0 to 1 over divergence_warm_up.
  double divergence_share = 1.0;
};

// Where an epoch begins, or is resumed.
struct EpochStart {
  int epoch = 0;      // epochs before this one
  int64_t step = 0;   // steps of this epoch that are already done
  int64_t steps = 0;  // number of steps in the epoch
  // The order of the training examples in memory, for the phases that learn from these.
  std::span<const int64_t> order;
};

// The batches and the loss of a phase. The loop calls BeginEpoch, then Next for each step, then
// EndEpoch. An error ends the run.
class EpochSteps {
 public:
  virtual ~EpochSteps() = default;

  // Begins an epoch, or resumes it at batch `start.step`.
  virtual absl::Status BeginEpoch(const EpochStart& start) = 0;
  // Computes the loss of the next batch, or micro-batch, and adds the terms of its bound to
  // `means`.
  virtual absl::StatusOr<BatchLoss> Next(const StepContext& context, TermMeans* means) = 0;
  // Adds the terms on held-out examples to the report, which already has those of training. With
  // nullptr, only ends the epoch.
  virtual void EndEpoch(v1::EpochReport* report) = 0;
};

// A phase as the loop sees it.
struct PhasePlan {
  std::string name;  // name of the phase in the job's progress and in checkpoints
  int epochs = 0;
  int64_t batch_size = 0;
  int64_t examples = 0;  // examples to learn from; an epoch uses at most max_examples of them
  // False if the caller has already begun the phase in the progress; no checkpoint is then written.
  // For phases that run the loop several times.
  bool resumable = true;
  // All ranks run the phase together, on micro-batches if the settings have some. False: rank 0
  // runs it alone, on whole batches.
  bool together = false;
};

// The state that the steps of a phase change.
struct PhaseState {
  at::Generator& generator;  // draws the order of the examples, and what the steps draw
  AdamW& optimizer;
  // Adds networks, and whatever else later steps depend on, to a checkpoint.
  std::function<void(Checkpoint*)> store;
  // For phases that ranks run together. Reads from a checkpoint what `store` wrote.
  std::function<void(const Checkpoint&)> restore = nullptr;
  // For phases in micro-batches: what a step changes beside the parameters (MicroBatches).
  std::vector<at::Tensor> averaged = {};
};

// Owns checkpoints, progress and stopping of a run, on each of its ranks. Not thread-safe.
class EpochLoop {
 public:
  // `data`, `progress` and `ranks` must outlive the loop. `settings` are complete.
  EpochLoop(const v1::TrainingSettings& settings, const TrainingData& data, RankGroup& ranks,
            TrainingProgress& progress);

  // Sets the weights that the run starts from, by their SHA-256. Call it before KeepCheckpoints. A
  // checkpoint of a run that started from other weights then belongs to another run.
  void NameStart(std::string weights_sha256) { start_weights_sha256_ = std::move(weights_sha256); }

  // Writes checkpoints to `folder`, which must outlive the loop, and resumes from its latest one,
  // if any. FAILED_PRECONDITION if that belongs to another run. For rank 0 alone.
  absl::Status KeepCheckpoints(CheckpointFolder* folder);
  // Tells the other ranks which phase rank 0 resumes from, for IsOver. Each rank calls it. Errors
  // are those of RankGroup.
  absl::Status ShareResumedPhase();

  // Returns the checkpoint that the run resumes from, until its phase has restored it; nullptr if
  // there is none.
  const Checkpoint* resumed() const { return resumed_ ? &*resumed_ : nullptr; }
  // Returns whether the run resumes from a phase other than `phase`. Because phases run in order,
  // `phase` was then over when the checkpoint was written.
  bool IsOver(std::string_view phase) const { return resumed_ && resumed_->phase() != phase; }

  // Learns for the epochs of the plan, from the checkpoint's position if this phase is resumed.
  //   CANCELLED            the run was asked to stop; a checkpoint of this moment was written
  //   ABORTED              the loss is no longer finite
  //   UNAVAILABLE          another rank is lost
  //   FAILED_PRECONDITION  this rank has other training examples than rank 0
  //   DATA_LOSS            the state that rank 0 sent is damaged
  //   others               those of CheckpointFolder::Write and of the steps
  absl::Status Run(const PhasePlan& plan, const PhaseState& state, EpochSteps& steps);

  TrainingProgress& progress() { return progress_; }
  RankGroup& ranks() { return ranks_; }
  // Returns this rank's micro-batches in phases that ranks run together.
  MicroBatchRange micro_batches() const;

 private:
  struct Position;
  struct Step;
  class Exchanges;

  absl::StatusOr<Position> BeginPhase(const PhasePlan& plan, const PhaseState& state,
                                      int64_t epoch_steps, TermMeans* means);
  // Restores everything but the networks from resumed_, which is of this phase.
  Position Resume(const PhaseState& state, int64_t epoch_steps, TermMeans* means);
  // Copies the state of rank 0, which is at `position`, to the other ranks. They resume there.
  absl::Status ShareState(const PhasePlan& plan, const PhaseState& state, const Position& position,
                          const TermMeans& means);
  // Takes a step with the whole batch.
  absl::Status TakeStep(const PhasePlan& plan, const PhaseState& state, const Step& step,
                        EpochSteps& steps, TermMeans* means);
  // Takes a step with all ranks.
  absl::Status TakeStepTogether(const PhasePlan& plan, const PhaseState& state, const Step& step,
                                EpochSteps& steps, Exchanges& exchanges, TermMeans* means);
  absl::Status EndEpoch(const PhasePlan& plan, EpochSteps& steps, TermMeans* means);
  at::Tensor BeginEpoch(const PhaseState& state, Position* position);
  // Writes a checkpoint if one is due or the run was asked to stop.
  absl::Status KeepCheckpoint(const PhasePlan& plan, const PhaseState& state,
                              const Position& position, const TermMeans& means);
  Checkpoint MakeCheckpoint(const PhasePlan& plan, const PhaseState& state,
                            const Position& position, const TermMeans& means) const;
  at::Tensor DrawEpoch(at::Generator& generator) const;
  double WarmUpShare(int64_t step, int64_t steps) const;

  const v1::TrainingSettings settings_;
  const TrainingData& data_;
  const int64_t training_examples_;
  RankGroup& ranks_;
  TrainingProgress& progress_;
  CheckpointFolder* checkpoints_ = nullptr;
  std::optional<Checkpoint> resumed_;
  std::string start_weights_sha256_;  // empty: random weights
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_EPOCH_LOOP_H_
