#include "model/learning/training_progress.h"

#include <google/protobuf/util/time_util.h>

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
      step_begun_(begun_),
      last_step_(begun_) {}

std::vector<TrainingProgress::Steps> TrainingProgress::KindsOf(const Phase& phase) {
  std::vector<Steps> kinds = {{phase.steps, phase.cost}};
  kinds.insert(kinds.end(), phase.others.begin(), phase.others.end());
  return kinds;
}

void TrainingProgress::BeginPhase(const std::string& name) {
  if (current_ >= 0) measured_[Present().name] = MeasuredNow();
  do {
    ++current_;
    // The plan and the run are of the same program.
    if (current_ >= static_cast<int>(phases_.size())) std::abort();
  } while (Present().name != name);
  epoch_ = 0;
  counted_.assign(1 + Present().others.size(), {});
  last_kind_ = 0;
  phase_examples_ = 0;
  phase_begun_ = step_begun_ = last_step_ = clock_();
  phase_stepping_ = {};
  phase_waited_ = {};
  ranks_waiting_.clear();
  Emit(Snapshot());
}

void TrainingProgress::Replan(std::vector<Phase> phases, bool in_seconds) {
  phases_ = std::move(phases);
  in_seconds_ = in_seconds;
}

void TrainingProgress::BeginEpoch(int epoch) {
  epoch_ = epoch;
  step_begun_ = clock_();
}

void TrainingProgress::Resume(int64_t phase_steps) {
  step_ = phase_steps;
  for (int i = 0; i < current_; ++i) {
    for (const Steps& kind : KindsOf(phases_[static_cast<size_t>(i)])) step_ += kind.count;
  }
  counted_.front().steps = phase_steps;
  resumed_at_ = std::clamp(DoneCost() / TotalCost(), 0.0, 1.0);
}

void TrainingProgress::Step(int64_t examples, std::chrono::nanoseconds waited, size_t kind) {
  const std::chrono::system_clock::time_point now = clock_();
  ++step_;
  ++counted_[kind].steps;
  // Between steps of two kinds there may be work of another sort.
  if (kind == last_kind_) {
    Measured& measured = counted_[kind].measured;
    measured.seconds += Seconds(now - last_step_);
    ++measured.steps;
  }
  last_kind_ = kind;
  last_step_ = now;
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

std::vector<TrainingProgress::Measured> TrainingProgress::MeasuredNow() const {
  std::vector<Measured> measured;
  for (const Counted& kind : counted_) measured.push_back(kind.measured);
  measured[last_kind_].seconds += Seconds(clock_() - last_step_);
  return measured;
}

std::vector<TrainingProgress::Measured> TrainingProgress::MeasuredOf(size_t phase) const {
  if (IsPresent(phase)) return MeasuredNow();
  const auto found = measured_.find(phases_[phase].name);
  return found == measured_.end() ? std::vector<Measured>() : found->second;
}

double TrainingProgress::SecondsPerCost() const {
  // The first few steps do not outweigh costs that are seconds.
  double seconds = in_seconds_ ? kEstimateFrom * TotalCost() : 0.0;
  double cost = seconds;
  for (size_t i = 0; i <= static_cast<size_t>(current_); ++i) {
    const std::vector<Steps> kinds = KindsOf(phases_[i]);
    const std::vector<Measured> measured = MeasuredOf(i);
    for (size_t kind = 0; kind < measured.size(); ++kind) {
      if (measured[kind].steps < kTellingSteps) continue;
      seconds += measured[kind].seconds;
      cost += kinds[kind].cost * static_cast<double>(measured[kind].steps);
    }
  }
  if (cost > 0.0) return seconds / cost;
  // Nothing has been measured but the whole.
  const double done = DoneCost() - resumed_at_ * TotalCost();
  return done > 0.0 ? Seconds(clock_() - begun_) / done : 0.0;
}

double TrainingProgress::SecondsLeft() const {
  const double per_cost = SecondsPerCost();
  const std::vector<Measured> now = MeasuredNow();
  double left = 0.0;
  for (size_t i = static_cast<size_t>(current_); i < phases_.size(); ++i) {
    const std::vector<Steps> kinds = KindsOf(phases_[i]);
    for (size_t kind = 0; kind < kinds.size(); ++kind) {
      double step = phases_[i].seconds.value_or(kinds[kind].cost * per_cost);
      int64_t steps = kinds[kind].count;
      if (IsPresent(i)) {
        steps = std::max<int64_t>(0, steps - counted_[kind].steps);
        const auto& [seconds, measured] = now[kind];
        if (measured >= kTellingSteps) step = seconds / static_cast<double>(measured);
      }
      left += static_cast<double>(steps) * step;
    }
  }
  return left;
}

double TrainingProgress::DoneCost() const {
  double cost = 0.0;
  for (size_t i = 0; static_cast<int>(i) <= current_; ++i) {
    const std::vector<Steps> kinds = KindsOf(phases_[i]);
    for (size_t kind = 0; kind < kinds.size(); ++kind) {
      const int64_t steps =
          IsPresent(i) ? std::min(counted_[kind].steps, kinds[kind].count) : kinds[kind].count;
      cost += kinds[kind].cost * static_cast<double>(steps);
    }
  }
  return cost;
}

double TrainingProgress::TotalCost() const {
  double cost = 0.0;
  for (const Phase& phase : phases_) {
    for (const Steps& kind : KindsOf(phase)) cost += kind.cost * static_cast<double>(kind.count);
  }
  return std::max(cost, 1e-9);
}

v1::JobProgress TrainingProgress::Snapshot() const {
  v1::JobProgress progress;
  const Phase& phase = Present();
  int64_t steps = 0;
  for (const Phase& each : phases_) {
    for (const Steps& kind : KindsOf(each)) steps += kind.count;
  }
  const double fraction = std::clamp(DoneCost() / TotalCost(), 0.0, 1.0);
  progress.set_phase(phase.name);
  progress.set_epoch(epoch_);
  progress.set_epochs(phase.epochs);
  progress.set_step(step_);
  progress.set_steps(std::max(steps, step_));
  progress.set_fraction(fraction);
  if (in_seconds_ || fraction >= resumed_at_ + kEstimateFrom) {
    *progress.mutable_time_left() =
        google::protobuf::util::TimeUtil::MillisecondsToDuration(std::llround(1e3 * SecondsLeft()));
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
