#include "model/learning/phases/epoch_loop.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/learning/epoch_size.h"
#include "model/learning/example_order.h"
#include "model/learning/run_state.h"

namespace maneuver::learning {
namespace {

absl::Status TakeStep(const std::string& phase, const at::Tensor& loss, double rate_share,
                      AdamW& optimizer) {
  if (!std::isfinite(loss.item<double>())) {
    return absl::AbortedError(absl::StrCat(
        "the loss of phase ", phase,
        " is no longer finite; lower optimization.learning_rate, or look for positions in the data "
        "that are far off"));
  }
  loss.backward();
  optimizer.Step(rate_share);
  return absl::OkStatus();
}

}  // namespace

// Where a phase is.
struct EpochLoop::Position {
  int epochs = 0;     // over
  int64_t steps = 0;  // over, of the epoch after them
  // Whether a checkpoint was written after the order of that epoch had been drawn.
  bool order_drawn = false;
  std::string epoch_random = {};  // state of the generator from which the order was drawn
};

EpochLoop::EpochLoop(const v1::TrainingSettings& settings, const TrainingData& data,
                     std::function<bool()> stopped, RunProgress& progress)
    : settings_(settings),
      data_(data),
      training_examples_(data.TrainingExamples()),
      stopped_(std::move(stopped)),
      progress_(progress) {}

absl::Status EpochLoop::KeepCheckpoints(CheckpointFolder* folder) {
  checkpoints_ = folder;
  resumed_ = folder->ReadLatest();
  if (!resumed_) return absl::OkStatus();
  if (resumed_->settings() == RunSettings(settings_) &&
      resumed_->training_examples() == training_examples_ &&
      resumed_->start_weights_sha256() == start_weights_sha256_) {
    return absl::OkStatus();
  }
  return absl::FailedPreconditionError(
      "the folder of checkpoints is of a run with other settings, other data or another start; "
      "name another folder, or empty this one to start anew");
}

absl::Status EpochLoop::Run(const PhasePlan& plan, const PhaseState& state, EpochSteps& steps) {
  const int64_t epoch_steps =
      StepsOfEpoch(EpochExamples(settings_, plan.examples), plan.batch_size);
  const int64_t all_steps = plan.epochs * epoch_steps;
  TermMeans means;
  Position now = BeginPhase(plan, state, epoch_steps, &means);
  for (; now.epochs < plan.epochs; now = {now.epochs + 1}) {
    const at::Tensor order = BeginEpoch(state, &now);
    absl::Status begun =
        steps.BeginEpoch({now.epochs,
                          now.steps,
                          epoch_steps,
                          {order.data_ptr<int64_t>(), static_cast<size_t>(order.size(0))}});
    if (!begun.ok()) return begun;
    for (; now.steps < epoch_steps; ++now.steps) {
      absl::Status status = KeepCheckpoint(plan, state, now, means);
      if (!status.ok()) return status;
      const int64_t step = now.epochs * epoch_steps + now.steps;
      const absl::StatusOr<BatchLoss> loss =
          steps.Next({now.epochs, WarmUpShare(step, all_steps)}, &means);
      if (!loss.ok()) return loss.status();
      means.Add("loss", loss->value, loss->examples);
      status = TakeStep(plan.name, loss->value, LearningRateShare(step, kWarmUpSteps, all_steps),
                        state.optimizer);
      if (!status.ok()) return status;
      progress_.Step(loss->examples, loss->waited);
    }
    v1::EpochReport report;
    std::exchange(means, {}).Write(report.mutable_training());
    steps.EndEpoch(&report);
    progress_.EndEpoch(report);
  }
  state.optimizer.ZeroGradients();
  return absl::OkStatus();
}

EpochLoop::Position EpochLoop::BeginPhase(const PhasePlan& plan, const PhaseState& state,
                                          int64_t epoch_steps, TermMeans* means) {
  if (!plan.resumable) return {};
  progress_.BeginPhase(plan.name);
  if (!resumed_ || resumed_->phase() != plan.name) return {};
  RestoreOptimizer(*resumed_, &state.optimizer);
  RestoreRandomState(resumed_->random(), &state.generator);
  means->Restore(*resumed_);
  Position position{resumed_->epochs(), resumed_->steps(), /*order_drawn=*/true,
                    resumed_->epoch_random()};
  progress_.Resume(position.epochs * epoch_steps + position.steps);
  resumed_.reset();
  return position;
}

at::Tensor EpochLoop::BeginEpoch(const PhaseState& state, Position* position) {
  progress_.BeginEpoch(position->epochs + 1);
  if (!position->order_drawn) {
    position->epoch_random = RandomState(state.generator);
    return DrawEpoch(state.generator);
  }
  // Draws the order of an epoch that has begun once more, from the state it was drawn from.
  const std::string now = RandomState(state.generator);
  RestoreRandomState(position->epoch_random, &state.generator);
  const at::Tensor order = DrawEpoch(state.generator);
  RestoreRandomState(now, &state.generator);
  return order;
}

absl::Status EpochLoop::KeepCheckpoint(const PhasePlan& plan, const PhaseState& state,
                                       const Position& position, const TermMeans& means) {
  const bool stops = stopped_();
  const absl::Status outcome =
      stops ? absl::CancelledError("training was stopped") : absl::OkStatus();
  if (checkpoints_ == nullptr || !plan.resumable) return outcome;
  const bool due = stops || checkpoints_->IsDue();
  checkpoints_->CountStep();
  if (!due) return outcome;
  Checkpoint checkpoint;
  checkpoint.set_settings(RunSettings(settings_));
  checkpoint.set_training_examples(training_examples_);
  checkpoint.set_phase(plan.name);
  checkpoint.set_epochs(position.epochs);
  checkpoint.set_steps(position.steps);
  checkpoint.set_epoch_random(position.epoch_random);
  checkpoint.set_random(RandomState(state.generator));
  checkpoint.set_data_memory(data_.data_memory);
  checkpoint.set_start_weights_sha256(start_weights_sha256_);
  state.store(&checkpoint);
  StoreOptimizer(state.optimizer, &checkpoint);
  means.Store(&checkpoint);
  const absl::Status written = checkpoints_->Write(checkpoint);
  return written.ok() ? outcome : written;
}

at::Tensor EpochLoop::DrawEpoch(at::Generator& generator) const {
  const int64_t in_memory = static_cast<int64_t>(data_.training.examples.size());
  return DrawExamples(DatasetSizes(data_), DatasetWeights(settings_),
                      EpochExamples(settings_, in_memory), generator);
}

double EpochLoop::WarmUpShare(int64_t step, int64_t steps) const {
  const double warm_up = settings_.optimization().divergence_warm_up() * static_cast<double>(steps);
  return warm_up > 0.0 ? std::min(1.0, static_cast<double>(step) / warm_up) : 1.0;
}

}  // namespace maneuver::learning
