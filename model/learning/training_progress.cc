#include "model/learning/training_progress.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

namespace maneuver::learning {
namespace {

constexpr std::chrono::milliseconds kBetween{500};
constexpr double kEstimateFrom = 0.02;  // of the whole: before it the time left is a guess
// A phase with fewer steps says little of what a step costs; loading has one.
constexpr int64_t kTellingSteps = 5;

double Seconds(std::chrono::system_clock::duration duration) {
  return std::chrono::duration<double>(duration).count();
}

}  // namespace

TrainingProgress::TrainingProgress(std::vector<Phase> phases, Sink sink, Clock clock)
    : phases_(std::move(phases)),
      sink_(std::move(sink)),
      clock_(std::move(clock)),
      begun_(clock_()),
      phase_begun_(begun_),
      last_emitted_(begun_),
      step_begun_(begun_) {}

void TrainingProgress::BeginPhase(const std::string& name) {
  if (current_ >= 0) measured_[phases_[static_cast<size_t>(current_)].name] = MeasuredNow();
  do {
    ++current_;
    // The plan and the run are of the same program.
    if (current_ >= static_cast<int>(phases_.size())) std::abort();
  } while (phases_[static_cast<size_t>(current_)].name != name);
  epoch_ = 0;
  phase_step_ = 0;
  phase_resumed_ = 0;
  phase_examples_ = 0;
  phase_begun_ = step_begun_ = clock_();
  phase_stepping_ = {};
  phase_waited_ = {};
  ranks_waiting_.clear();
  Emit(Snapshot());
}

void TrainingProgress::Replan(std::vector<Phase> phases) { phases_ = std::move(phases); }

void TrainingProgress::BeginEpoch(int epoch) {
  epoch_ = epoch;
  step_begun_ = clock_();
}

void TrainingProgress::Resume(int64_t phase_steps) {
  step_ = phase_steps;
  for (int i = 0; i < current_; ++i) step_ += phases_[static_cast<size_t>(i)].steps;
  phase_step_ = phase_steps;
  phase_resumed_ = phase_steps;
  resumed_at_ = std::clamp(DoneCost() / TotalCost(), 0.0, 1.0);
}

void TrainingProgress::Step(int64_t examples, std::chrono::nanoseconds waited) {
  const std::chrono::system_clock::time_point now = clock_();
  ++step_;
  ++phase_step_;
  phase_examples_ += examples;
  phase_stepping_ += now - std::exchange(step_begun_, now);
  phase_waited_ += waited;
  if (now - last_emitted_ >= kBetween) Emit(Snapshot());
}

void TrainingProgress::EndEpoch(const v1::EpochReport& report) {
  v1::JobProgress progress = Snapshot();
  *progress.mutable_epoch_report() = report;
  Emit(std::move(progress));
}

void TrainingProgress::SetRanks(double slowest_step, std::vector<double> waiting) {
  slowest_step_ = slowest_step;
  ranks_waiting_ = std::move(waiting);
}

TrainingProgress::Measured TrainingProgress::MeasuredNow() const {
  return {Seconds(clock_() - phase_begun_), phase_step_ - phase_resumed_};
}

TrainingProgress::Measured TrainingProgress::MeasuredOf(const std::string& phase) const {
  const auto found = measured_.find(phase);
  return found == measured_.end() ? Measured() : found->second;
}

double TrainingProgress::SecondsPerCost() const {
  double seconds = 0.0;
  double cost = 0.0;
  for (int i = 0; i <= current_; ++i) {
    const Phase& phase = phases_[static_cast<size_t>(i)];
    const Measured measured = i == current_ ? MeasuredNow() : MeasuredOf(phase.name);
    if (measured.steps < kTellingSteps) continue;
    seconds += measured.seconds;
    cost += phase.cost * static_cast<double>(measured.steps);
  }
  if (cost > 0.0) return seconds / cost;
  // Nothing has been measured but the whole.
  const double done = DoneCost() - resumed_at_ * TotalCost();
  return done > 0.0 ? Seconds(clock_() - begun_) / done : 0.0;
}

double TrainingProgress::SecondsLeft() const {
  const double per_cost = SecondsPerCost();
  double left = 0.0;
  for (size_t i = static_cast<size_t>(current_); i < phases_.size(); ++i) {
    const Phase& phase = phases_[i];
    double step = phase.seconds.value_or(phase.cost * per_cost);
    int64_t steps = phase.steps;
    if (i == static_cast<size_t>(current_)) {
      steps = std::max<int64_t>(0, steps - phase_step_);
      const Measured now = MeasuredNow();
      if (now.steps >= kTellingSteps) step = now.seconds / static_cast<double>(now.steps);
    }
    left += static_cast<double>(steps) * step;
  }
  return left;
}

double TrainingProgress::DoneCost() const {
  double cost = 0.0;
  for (int i = 0; i < current_; ++i) {
    cost += phases_[static_cast<size_t>(i)].cost *
            static_cast<double>(phases_[static_cast<size_t>(i)].steps);
  }
  if (current_ >= 0) {
    const Phase& phase = phases_[static_cast<size_t>(current_)];
    cost += phase.cost * static_cast<double>(std::min(phase_step_, phase.steps));
  }
  return cost;
}

double TrainingProgress::TotalCost() const {
  double cost = 0.0;
  for (const Phase& phase : phases_) cost += phase.cost * static_cast<double>(phase.steps);
  return std::max(cost, 1e-9);
}

v1::JobProgress TrainingProgress::Snapshot() const {
  v1::JobProgress progress;
  const Phase& phase = phases_[static_cast<size_t>(current_)];
  int64_t steps = 0;
  for (const Phase& each : phases_) steps += each.steps;
  const double fraction = std::clamp(DoneCost() / TotalCost(), 0.0, 1.0);
  progress.set_phase(phase.name);
  progress.set_epoch(epoch_);
  progress.set_epochs(phase.epochs);
  progress.set_step(step_);
  progress.set_steps(std::max(steps, step_));
  progress.set_fraction(fraction);
  if (fraction >= resumed_at_ + kEstimateFrom) {
    progress.mutable_time_left()->set_seconds(static_cast<int64_t>(std::ceil(SecondsLeft())));
  }
  const double phase_seconds = Seconds(clock_() - phase_begun_);
  if (phase_seconds > 0.0) {
    progress.set_examples_per_second(static_cast<double>(phase_examples_) / phase_seconds);
  }
  if (const double stepping = Seconds(phase_stepping_); stepping > 0.0) {
    const double waited = std::chrono::duration<double>(phase_waited_).count();
    progress.set_waiting_fraction(std::min(1.0, waited / stepping));
  }
  if (!ranks_waiting_.empty()) {
    progress.set_slowest_rank_step_seconds(slowest_step_);
    progress.mutable_rank_waiting_fractions()->Assign(ranks_waiting_.begin(), ranks_waiting_.end());
  }
  return progress;
}

void TrainingProgress::Emit(v1::JobProgress progress) {
  const std::chrono::system_clock::time_point now = clock_();
  last_emitted_ = now;
  const int64_t nanoseconds =
      std::chrono::duration_cast<std::chrono::nanoseconds>(now.time_since_epoch()).count();
  progress.set_sequence(++sequence_);
  progress.mutable_time()->set_seconds(nanoseconds / 1'000'000'000);
  progress.mutable_time()->set_nanos(static_cast<int32_t>(nanoseconds % 1'000'000'000));
  if (sink_) sink_(progress);
}

}  // namespace maneuver::learning
