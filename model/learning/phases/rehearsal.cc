#include "model/learning/phases/rehearsal.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <string>
#include <vector>

#include "model/learning/checkpoint_contents.h"
#include "model/learning/networks.h"
#include "model/learning/phases/joint.h"
#include "model/learning/phases/pretrain.h"
#include "model/learning/ranks/rank_group.h"

namespace maneuver::learning {
namespace {

constexpr int64_t kFewestPlanned = 100;  // steps: a shorter phase is soon over
constexpr int64_t kOneIn = 40;           // steps, of which one is rehearsed
constexpr int64_t kFewestSteps = 4;
constexpr int64_t kMostSteps = 40;
constexpr int64_t kOneCalibratedIn = 10;  // examples, of which one is in a rehearsal
constexpr int64_t kFewestCalibrated =
    400;  // held-out examples: a calibration by fewer is soon over

// Keeps networks and random numbers, and puts them back when it goes.
class StateGuard {
 public:
  explicit StateGuard(LearningState& state)
      : state_(state), networks_(state.networks.Save()), random_(RandomState(state.generator)) {}
  ~StateGuard() {
    state_.networks.Restore(networks_);
    RestoreRandomState(random_, &state_.generator);
    // A gradient that is left would be added to the next one.
    for (const auto& [name, tensor] : networks_) state_.networks[name].mutable_grad().reset();
  }
  StateGuard(const StateGuard&) = delete;
  StateGuard& operator=(const StateGuard&) = delete;

 private:
  LearningState& state_;
  const Networks::Snapshot networks_;
  const std::string random_;
};

}  // namespace

std::optional<double> RehearseStep(const TrainingProgress::Phase& planned,
                                   const RehearsedPhase& phase, LearningState& state,
                                   const TrainingProgress::Clock& clock) {
  if (planned.steps < kFewestPlanned) return std::nullopt;
  const int64_t steps = std::clamp(planned.steps / kOneIn, kFewestSteps, kMostSteps);
  v1::TrainingSettings settings = state.settings;
  settings.mutable_examples()->set_max_examples(steps * phase.batch_size);
  // The loop asks at each step whether to stop: it is time at the first step of the second epoch.
  std::vector<std::chrono::system_clock::time_point> begun;
  const auto stopped = [&] {
    begun.push_back(clock());
    return state.stopped() || static_cast<int64_t>(begun.size()) > steps;
  };
  const StateGuard guard(state);
  TrainingProgress unheard({planned}, nullptr, clock);
  RankGroup alone(stopped);
  EpochLoop loop(settings, state.data, alone, unheard);
  const absl::Status status = phase.learn(state, loop);
  if (status.ok()) begun.push_back(clock());  // it has one epoch
  const auto count = static_cast<int64_t>(begun.size());
  if (state.stopped() || count != steps + 1) return std::nullopt;
  const auto seconds = [&begun](int64_t from, int64_t to) {
    return std::chrono::duration<double>(begun[static_cast<size_t>(to)] -
                                         begun[static_cast<size_t>(from)])
        .count();
  };
  // The first step also waits for the first batch.
  const double step = seconds(1, steps - 1) / static_cast<double>(steps - 2);
  const double validation = std::max(0.0, seconds(steps - 1, steps) - step);
  return step / phase.ranks + validation * planned.epochs / static_cast<double>(planned.steps);
}

std::optional<std::vector<double>> RehearseCalibration(const RehearsedCalibration& calibration,
                                                       LearningState& state,
                                                       const TrainingProgress::Clock& clock) {
  if (calibration.examples.held_out < kFewestCalibrated) return std::nullopt;
  struct Measured {
    double seconds = 0.0;
    int64_t examples = 0;
  };
  std::array<Measured, kCalibrationStepKinds> measured;
  std::optional<CalibrationStep> last;
  std::chrono::system_clock::time_point last_end;
  const auto count = [&](CalibrationStep kind, int64_t examples) {
    const std::chrono::system_clock::time_point now = clock();
    if (last == kind) {  // else other work came before it
      Measured& each = measured[static_cast<size_t>(kind)];
      each.seconds += std::chrono::duration<double>(now - last_end).count();
      each.examples += examples;
    }
    last = kind;
    last_end = now;
  };
  const auto few = [](int64_t examples) {
    return std::max(artifact::kFewestHeldOut, examples / kOneCalibratedIn);
  };
  const StateGuard guard(state);
  const absl::Status status = calibration.calibrate(
      {few(calibration.examples.training), few(calibration.examples.held_out)}, count);
  if (!status.ok() || state.stopped()) return std::nullopt;
  std::vector<double> seconds;
  for (size_t kind = 0; kind < kCalibrationStepKinds; ++kind) {
    const PlannedSteps& planned = calibration.steps[kind];
    const auto& [took, examples] = measured[kind];
    if (planned.count > 0 && examples == 0) return std::nullopt;
    seconds.push_back(planned.count == 0 ? 0.0
                                         : took / static_cast<double>(examples) *
                                               static_cast<double>(planned.examples));
  }
  return seconds;
}

std::vector<TrainingProgress::Phase> WithMeasuredSteps(std::vector<TrainingProgress::Phase> plan,
                                                       const MeasuredSteps& measured) {
  const auto joint = std::ranges::find(plan, kJointPhase, &TrainingProgress::Phase::name);
  if (joint == plan.end() || !measured.contains(kJointPhase)) return plan;
  const double joint_scale = measured.at(kJointPhase).front() / joint->cost;
  double scale = joint_scale;
  for (TrainingProgress::Phase& phase : plan) {
    if (phase.name == kJointPhase) scale = joint_scale;
    const auto found = measured.find(phase.name);
    if (found != measured.end() && phase.name == kPretrainPhase) {
      scale = found->second.front() / phase.cost;
    }
    phase.cost = found != measured.end() ? found->second.front()
                                         : phase.seconds.value_or(phase.cost * scale);
    for (size_t i = 0; i < phase.others.size(); ++i) {
      double& cost = phase.others[i].cost;
      cost = found != measured.end() ? found->second[i + 1] : cost * scale;
    }
  }
  return plan;
}

}  // namespace maneuver::learning
