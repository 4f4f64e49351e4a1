// The loop over epochs and steps that every phase learns in.

#ifndef MANEUVER_MODEL_LEARNING_PHASES_EPOCH_LOOP_H_
#define MANEUVER_MODEL_LEARNING_PHASES_EPOCH_LOOP_H_

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/checkpoint.h"
#include "model/learning/optimizer.h"
#include "model/learning/run_progress.h"
#include "model/learning/tensors.h"
#include "model/learning/training_data.h"
#include "model/learning/validation.h"

namespace maneuver::learning {

// The position of a step in its phase.
struct Moment {
  int epoch = 0;  // epochs before this one
  // Factor of the weights of the divergences: rises from 0 to 1 over divergence_warm_up.
  double divergence_share = 1.0;
};

// A batch's loss, to be minimised.
struct BatchLoss {
  at::Tensor value;  // a scalar with its graph
  int64_t examples = 0;
  std::chrono::nanoseconds waited{0};  // for the batch
};

// Where an epoch begins, or is resumed.
struct EpochStart {
  int epoch = 0;      // epochs before this one
  int64_t step = 0;   // steps of this epoch that were done before
  int64_t steps = 0;  // in the epoch
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
  // Computes the loss of the next batch and adds the terms of its bound to `means`.
  virtual absl::StatusOr<BatchLoss> Next(const Moment& moment, TermMeans* means) = 0;
  // Adds what held-out examples say to the report, which has the terms of training.
  virtual void EndEpoch(v1::EpochReport* report) = 0;
};

// A phase as the loop sees it.
struct PhasePlan {
  std::string name;  // of the phase in progress and in checkpoints
  int epochs = 0;
  int64_t batch_size = 0;
  int64_t examples = 0;  // that the phase learns from; an epoch has at most max_examples of them
  // False: the caller has already begun the phase in the progress, and no checkpoint is written.
  // For phases that run the loop several times.
  bool resumable = true;
};

// The state that the steps of a phase change.
struct PhaseState {
  at::Generator& generator;  // draws the order of the examples, and what the steps draw
  AdamW& optimizer;
  // Adds networks, and whatever else later steps depend on, to a checkpoint.
  std::function<void(Checkpoint*)> store;
};

// Owns checkpoints, progress and stopping of a run. Not thread-safe.
class EpochLoop {
 public:
  // `data` and `progress` must outlive the loop. `settings` are complete.
  EpochLoop(const v1::TrainingSettings& settings, const TrainingData& data,
            std::function<bool()> stopped, RunProgress& progress);

  // Sets the weights that the run starts from, by their SHA-256. Call it before KeepCheckpoints. A
  // checkpoint of a run that started from other weights then belongs to another run.
  void NameStart(std::string weights_sha256) { start_weights_sha256_ = std::move(weights_sha256); }

  // Writes checkpoints to `folder`, which must outlive the loop, and resumes from its latest one,
  // if any. FAILED_PRECONDITION if that belongs to another run.
  absl::Status KeepCheckpoints(CheckpointFolder* folder);

  // Returns the checkpoint that the run resumes from, until its phase has restored it; nullptr if
  // there is none.
  const Checkpoint* resumed() const { return resumed_ ? &*resumed_ : nullptr; }
  // Returns whether the run resumes from a phase other than `phase`. Because phases run in order,
  // `phase` was then over when the checkpoint was written.
  bool IsOver(std::string_view phase) const { return resumed_ && resumed_->phase() != phase; }

  // Learns for the epochs of the plan, from the checkpoint's position if this phase is resumed.
  //   CANCELLED  the run was asked to stop; a checkpoint of this moment was written
  //   ABORTED    the loss is no longer finite
  //   others     those of CheckpointFolder::Write
  absl::Status Run(const PhasePlan& plan, const PhaseState& state, EpochSteps& steps);

  RunProgress& progress() { return progress_; }

 private:
  struct Position;

  Position BeginPhase(const PhasePlan& plan, const PhaseState& state, int64_t epoch_steps,
                      TermMeans* means);
  at::Tensor BeginEpoch(const PhaseState& state, Position* position);
  // Writes a checkpoint if one is due or the run was asked to stop.
  absl::Status KeepCheckpoint(const PhasePlan& plan, const PhaseState& state,
                              const Position& position, const TermMeans& means);
  at::Tensor DrawEpoch(at::Generator& generator) const;
  double WarmUpShare(int64_t step, int64_t steps) const;

  const v1::TrainingSettings settings_;
  const TrainingData& data_;
  const int64_t training_examples_;
  const std::function<bool()> stopped_;
  RunProgress& progress_;
  CheckpointFolder* checkpoints_ = nullptr;
  std::optional<Checkpoint> resumed_;
  std::string start_weights_sha256_;  // empty: random weights
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_EPOCH_LOOP_H_
