#include "model/learning/phases/epoch_loop.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/data/stable_hash.h"
#include "model/learning/checkpoint_contents.h"
#include "model/learning/epoch_size.h"
#include "model/learning/example_order.h"
#include "model/learning/phases/micro_batches.h"

namespace maneuver::learning {
namespace {

using Clock = std::chrono::steady_clock;

double ElapsedSeconds(Clock::duration duration) {
  return std::chrono::duration<double>(duration).count();
}

absl::Status CheckFinite(const std::string& phase, const at::Tensor& loss) {
  if (std::isfinite(loss.item<double>())) return absl::OkStatus();
  return absl::AbortedError(absl::StrCat(
      "the loss of phase ", phase,
      " is no longer finite; lower optimization.learning_rate, or look for positions in the data "
      "that are far off"));
}

// Draws from another seed while it lives, then from where the generator was.
class Reseeded {
 public:
  explicit Reseeded(at::Generator& generator)
      : generator_(generator), before_(RandomState(generator)) {}
  ~Reseeded() { RestoreRandomState(before_, &generator_); }
  Reseeded(const Reseeded&) = delete;
  Reseeded& operator=(const Reseeded&) = delete;

  // Noise and dropout of a micro-batch depend on these numbers alone.
  void Seed(int64_t seed, std::string_view phase, int64_t step, int micro_batch) {
    uint64_t hash = data::MixHash(static_cast<uint64_t>(seed), data::StableHash(phase));
    hash = data::MixHash(hash, static_cast<uint64_t>(step));
    generator_.set_current_seed(data::MixHash(hash, static_cast<uint64_t>(micro_batch)));
  }

 private:
  at::Generator& generator_;
  const std::string before_;
};

}  // namespace

// Where a phase is.
struct EpochLoop::Position {
  int epochs = 0;     // over
  int64_t steps = 0;  // over, of the epoch after them
  // Whether a checkpoint was written after the order of that epoch had been drawn.
  bool order_drawn = false;
  std::string epoch_random = {};  // state of the generator from which the order was drawn
};

struct EpochLoop::Step {
  int64_t number = 0;  // in the phase, from 0
  StepContext context;
  double rate_share = 1.0;
};

// What the ranks exchange in a phase, and the time that it takes them.
class EpochLoop::Exchanges {
 public:
  Exchanges(RankGroup& ranks, const MicroBatchRange& range, const PhaseState& state)
      : ranks_(ranks), micro_batches_(range, ranks, state.optimizer, state.averaged) {}

  // Computes this rank's gradients, then combines those of all ranks. Returns their notes.
  //   note: to be filled by `loss_of`
  absl::StatusOr<std::vector<RankNote>> Take(const MicroBatches::LossOf& loss_of, RankNote* note) {
    const Clock::time_point begin = Clock::now();
    WriteStatus(micro_batches_.Compute(loss_of), note);
    const Clock::time_point computed = Clock::now();
    worked_ += ElapsedSeconds(computed - begin);
    note->set_worked_seconds(worked_);
    note->set_exchanged_seconds(exchanged_);
    absl::StatusOr<std::vector<RankNote>> notes = ranks_.Exchange(*note);
    if (!notes.ok()) return notes;
    absl::Status status = FirstError(*notes);
    if (status.ok()) status = micro_batches_.Combine();
    if (!status.ok()) return status;
    exchanged_ += ElapsedSeconds(Clock::now() - computed);
    ++steps_;
    return notes;
  }

  // Returns how many steps were taken in this process.
  int64_t steps() const { return steps_; }

 private:
  RankGroup& ranks_;
  MicroBatches micro_batches_;
  double worked_ = 0.0;     // seconds
  double exchanged_ = 0.0;  // seconds
  int64_t steps_ = 0;
};

EpochLoop::EpochLoop(const v1::TrainingSettings& settings, const TrainingData& data,
                     RankGroup& ranks, TrainingProgress& progress)
    : settings_(settings),
      data_(data),
      training_examples_(data.TrainingExamples()),
      ranks_(ranks),
      progress_(progress) {}

MicroBatchRange EpochLoop::micro_batches() const {
  const int count = settings_.optimization().micro_batches();
  return count == 0 ? MicroBatchRange{} : RangeOfRank(count, ranks_.rank(), ranks_.size());
}

absl::Status EpochLoop::KeepCheckpoints(CheckpointFolder* folder) {
  checkpoints_ = folder;
  resumed_ = folder->ReadLatest();
  if (!resumed_) return absl::OkStatus();
  if (resumed_->settings() == IdentifyingSettings(settings_) &&
      resumed_->training_examples() == training_examples_ &&
      resumed_->start_weights_sha256() == start_weights_sha256_) {
    return absl::OkStatus();
  }
  return absl::FailedPreconditionError(
      "the folder of checkpoints is of a run with other settings, other data or another start; "
      "name another folder, or empty this one to start anew");
}

absl::Status EpochLoop::ShareResumedPhase() {
  std::string phase = resumed_ ? resumed_->phase() : "";
  const absl::Status status = ranks_.Broadcast(&phase);
  if (!status.ok() || ranks_.rank() == 0) return status;
  resumed_.reset();
  if (!phase.empty()) resumed_.emplace().set_phase(phase);
  return absl::OkStatus();
}

absl::Status EpochLoop::Run(const PhasePlan& plan, const PhaseState& state, EpochSteps& steps) {
  const int64_t epoch_steps =
      StepsOfEpoch(EpochExamples(settings_, plan.examples), plan.batch_size);
  const int64_t all_steps = plan.epochs * epoch_steps;
  TermMeans means;
  absl::StatusOr<Position> begun = BeginPhase(plan, state, epoch_steps, &means);
  if (!begun.ok()) return begun.status();
  std::optional<Exchanges> exchanges;
  if (plan.together && settings_.optimization().micro_batches() > 0) {
    exchanges.emplace(ranks_, micro_batches(), state);
  }
  for (Position now = *std::move(begun); now.epochs < plan.epochs; now = {now.epochs + 1}) {
    const at::Tensor order = BeginEpoch(state, &now);
    absl::Status status =
        steps.BeginEpoch({now.epochs,
                          now.steps,
                          epoch_steps,
                          {order.data_ptr<int64_t>(), static_cast<size_t>(order.size(0))}});
    if (!status.ok()) return status;
    for (; now.steps < epoch_steps; ++now.steps) {
      status = KeepCheckpoint(plan, state, now, means);
      if (!status.ok()) return status;
      const int64_t number = now.epochs * epoch_steps + now.steps;
      const Step step{number,
                      {now.epochs, WarmUpShare(number, all_steps)},
                      LearningRateShare(number, kWarmUpSteps, all_steps)};
      status = exchanges ? TakeStepTogether(plan, state, step, steps, *exchanges, &means)
                         : TakeStep(plan, state, step, steps, &means);
      if (!status.ok()) return status;
    }
    status = EndEpoch(plan, steps, &means);
    if (!status.ok()) return status;
  }
  state.optimizer.ZeroGradients();
  return absl::OkStatus();
}

absl::Status EpochLoop::TakeStep(const PhasePlan& plan, const PhaseState& state, const Step& step,
                                 EpochSteps& steps, TermMeans* means) {
  const absl::StatusOr<BatchLoss> loss = steps.Next(step.context, means);
  if (!loss.ok()) return loss.status();
  means->Add("loss", loss->value, loss->examples);
  const absl::Status finite = CheckFinite(plan.name, loss->value);
  if (!finite.ok()) return finite;
  loss->value.backward();
  state.optimizer.Step(step.rate_share);
  progress_.Step(loss->examples, loss->waited);
  return absl::OkStatus();
}

absl::Status EpochLoop::TakeStepTogether(const PhasePlan& plan, const PhaseState& state,
                                         const Step& step, EpochSteps& steps, Exchanges& exchanges,
                                         TermMeans* means) {
  Reseeded random(state.generator);
  RankNote note;
  TermMeans own;
  std::chrono::nanoseconds waited{0};
  const auto loss_of = [&](int micro_batch) -> absl::StatusOr<BatchLoss> {
    random.Seed(settings_.seed(), plan.name, step.number, micro_batch);
    absl::StatusOr<BatchLoss> loss = steps.Next(step.context, &own);
    if (!loss.ok() || loss->examples == 0) return loss;
    own.Add("loss", loss->value, loss->examples);
    note.set_examples(note.examples() + loss->examples);
    waited += loss->waited;
    own.Store(note.mutable_means());
    const absl::Status finite = CheckFinite(plan.name, loss->value);
    if (!finite.ok()) return finite;
    return loss;
  };
  const absl::StatusOr<std::vector<RankNote>> notes = exchanges.Take(loss_of, &note);
  if (!notes.ok()) return notes.status();
  state.optimizer.Step(step.rate_share);
  int64_t examples = 0;
  double slowest = 0.0;
  std::vector<double> waiting;
  for (const RankNote& each : *notes) {
    means->Add(each.means());
    examples += each.examples();
    slowest = std::max(slowest, each.worked_seconds());
    const double all = each.worked_seconds() + each.exchanged_seconds();
    waiting.push_back(all > 0.0 ? each.exchanged_seconds() / all : 0.0);
  }
  if (ranks_.size() > 1) {
    progress_.SetRanks(slowest / static_cast<double>(exchanges.steps()), std::move(waiting));
  }
  progress_.Step(examples, waited);
  return absl::OkStatus();
}

absl::Status EpochLoop::EndEpoch(const PhasePlan& plan, EpochSteps& steps, TermMeans* means) {
  v1::EpochReport report;
  std::exchange(*means, {}).Write(report.mutable_training());
  const auto measure = [&] {
    steps.EndEpoch(&report);
    return absl::OkStatus();
  };
  if (plan.together) {
    if (ranks_.rank() != 0) steps.EndEpoch(nullptr);
    const absl::Status status = ranks_.OnRankZero(measure);
    if (!status.ok()) return status;
  } else {
    measure().IgnoreError();
  }
  progress_.EndEpoch(report);
  return absl::OkStatus();
}

absl::StatusOr<EpochLoop::Position> EpochLoop::BeginPhase(const PhasePlan& plan,
                                                          const PhaseState& state,
                                                          int64_t epoch_steps, TermMeans* means) {
  if (!plan.resumable) return Position{};
  progress_.BeginPhase(plan.name);
  Position position;
  if (resumed_ && resumed_->phase() == plan.name && ranks_.rank() == 0) {
    position = Resume(state, epoch_steps, means);
  }
  if (!plan.together || ranks_.size() == 1) return position;
  const absl::Status status = ShareState(plan, state, position, *means);
  if (!status.ok()) return status;
  if (ranks_.rank() == 0) return position;
  state.restore(*resumed_);
  return Resume(state, epoch_steps, means);
}

EpochLoop::Position EpochLoop::Resume(const PhaseState& state, int64_t epoch_steps,
                                      TermMeans* means) {
  RestoreOptimizer(*resumed_, &state.optimizer);
  RestoreRandomState(resumed_->random(), &state.generator);
  *means = {};
  means->Add(resumed_->means());
  const Position position{resumed_->epochs(), resumed_->steps(),
                          /*order_drawn=*/!resumed_->epoch_random().empty(),
                          resumed_->epoch_random()};
  progress_.Resume(position.epochs * epoch_steps + position.steps);
  resumed_.reset();
  return position;
}

absl::Status EpochLoop::ShareState(const PhasePlan& plan, const PhaseState& state,
                                   const Position& position, const TermMeans& means) {
  std::string bytes;
  if (ranks_.rank() == 0) bytes = MakeCheckpoint(plan, state, position, means).SerializeAsString();
  const absl::Status status = ranks_.Broadcast(&bytes);
  if (!status.ok()) return status;
  return ranks_.Apart([&] {
    if (ranks_.rank() == 0) return absl::OkStatus();
    if (!resumed_.emplace().ParseFromString(bytes)) {
      return absl::DataLossError("the data that rank 0 sent are damaged");
    }
    return resumed_->training_examples() == training_examples_
               ? absl::OkStatus()
               : absl::FailedPreconditionError(absl::StrCat(
                     "has ", training_examples_, " training examples, but rank 0 has ",
                     resumed_->training_examples(), "; give all ranks the same datasets"));
  });
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
  // In a phase of all ranks, all stop before the same step.
  const bool stops =
      plan.together && ranks_.size() > 1 ? ranks_.HeardStop() : ranks_.StopRequested();
  const absl::Status outcome =
      stops ? absl::CancelledError("training was stopped") : absl::OkStatus();
  if (checkpoints_ == nullptr || !plan.resumable) return outcome;
  const bool due = stops || checkpoints_->IsDue();
  checkpoints_->CountStep();
  if (!due) return outcome;
  const absl::Status written = checkpoints_->Write(MakeCheckpoint(plan, state, position, means));
  return written.ok() ? outcome : written;
}

Checkpoint EpochLoop::MakeCheckpoint(const PhasePlan& plan, const PhaseState& state,
                                     const Position& position, const TermMeans& means) const {
  Checkpoint checkpoint;
  checkpoint.set_settings(IdentifyingSettings(settings_));
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
  means.Store(checkpoint.mutable_means());
  return checkpoint;
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
