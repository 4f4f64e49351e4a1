// Reports the progress of a training run.

#ifndef MANEUVER_MODEL_LEARNING_TRAINING_PROGRESS_H_
#define MANEUVER_MODEL_LEARNING_TRAINING_PROGRESS_H_

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "maneuver/v1/training_service.pb.h"

namespace maneuver::learning {

// Counts steps over phases and turns them into JobProgress messages: one at the start of each
// phase, one at the end of each epoch, and otherwise at most two a second. Not thread-safe.
class TrainingProgress {
 public:
  using Clock = std::function<std::chrono::system_clock::time_point()>;
  using Sink = std::function<void(const v1::JobProgress&)>;

  // Steps of one kind. `cost` is the approximate time of a step, in any unit, the same for all
  // phases. It makes `fraction` grow evenly. It also gives the time of phases that have not begun,
  // scaled by the time of the steps so far. The time left of a phase in progress is estimated from
  // its own steps, by kind.
  struct Steps {
    int64_t count = 0;  // in all epochs
    double cost = 1.0;
  };
  // A phase of the plan.
  struct Phase {
    std::string name;
    int epochs = 1;
    int64_t steps = 0;  // in all epochs
    double cost = 1.0;  // of a step
    // The time of a step if it is known. It replaces the estimate for a phase that has not begun;
    // `cost` should then be about the same.
    std::optional<double> seconds = std::nullopt;
    // Steps of other kinds, which take another time. They may come between the first ones.
    std::vector<Steps> others = {};
  };

  //   sink: receives the messages, on the calling thread; may be empty
  TrainingProgress(std::vector<Phase> phases, Sink sink, Clock clock);

  // Begins the phase `name`, which must come later in the plan: otherwise the program aborts. Skips
  // the phases between.
  void BeginPhase(const std::string& name);
  // Replaces the plan once it is better known. Phases that are over stay over.
  //   in_seconds: whether the costs are seconds. The time left is then reported from now on, and
  //     not only once 2 % of the run have shown what a step takes
  void Replan(std::vector<Phase> phases, bool in_seconds = false);
  const std::vector<Phase>& plan() const { return phases_; }
  const Clock& clock() const { return clock_; }
  void BeginEpoch(int epoch);  // from 1
  // Says that an earlier process did all earlier phases and `phase_steps` steps of this one.
  void Resume(int64_t phase_steps);
  // Counts one step over `examples` examples. The step waited for its batch for `waited`.
  //   kind: 0, or 1 + its index in the `others` of the phase
  void Step(int64_t examples, std::chrono::nanoseconds waited = {}, size_t kind = 0);
  void EndEpoch(const v1::EpochReport& report);
  // Sets what the ranks have measured in the present phase. Call it before Step.
  //   slowest_step: the slowest rank's own work for a step, seconds, mean of the phase
  //   waiting: share of each rank's time in which it waited for others or exchanged gradients
  void SetRanks(double slowest_step, std::vector<double> waiting);

 private:
  // Time of the steps of one kind, including everything between two of them, such as validation.
  struct Measured {
    double seconds = 0.0;
    int64_t steps = 0;
  };
  // What is known of one kind of steps in the present phase.
  struct Counted {
    Measured measured;
    int64_t steps = 0;  // done, also by an earlier process
  };
  static std::vector<Steps> KindsOf(const Phase& phase);  // the first kind first
  bool IsPresent(size_t phase) const { return static_cast<int>(phase) == current_; }
  const Phase& Present() const { return phases_[static_cast<size_t>(current_)]; }
  // Return what was measured of each kind.
  std::vector<Measured> MeasuredNow() const;
  std::vector<Measured> MeasuredOf(size_t phase) const;  // of the present phase or one before
  // Returns the seconds per unit of cost of all steps that were measured.
  double SecondsPerCost() const;
  double SecondsLeft() const;
  double DoneCost() const;
  double TotalCost() const;
  v1::JobProgress Snapshot() const;
  void Emit(v1::JobProgress progress);

  std::vector<Phase> phases_;
  bool in_seconds_ = false;                                // the costs
  std::map<std::string, std::vector<Measured>> measured_;  // by name, of phases that are over
  Sink sink_;
  Clock clock_;
  std::chrono::system_clock::time_point begun_;
  std::chrono::system_clock::time_point phase_begun_;
  std::chrono::system_clock::time_point last_emitted_;
  std::chrono::system_clock::time_point step_begun_;
  // In the present phase: time of its steps, and how much of it they waited.
  std::chrono::system_clock::duration phase_stepping_{0};
  std::chrono::nanoseconds phase_waited_{0};
  int current_ = -1;
  int epoch_ = 0;
  std::vector<Counted> counted_;  // by kind
  // The kind of the latest step, and when it ended; at first, that the phase began.
  size_t last_kind_ = 0;
  std::chrono::system_clock::time_point last_step_;
  int64_t phase_examples_ = 0;
  double slowest_step_ = 0.0;          // seconds
  std::vector<double> ranks_waiting_;  // shares
  int64_t step_ = 0;
  int64_t sequence_ = 0;
  double resumed_at_ = 0.0;  // fraction
};

// Counts the steps of a phase in which examples are measured: equal parts of them.
class ExampleSteps {
 public:
  //   steps: of the phase. `progress` must outlive this object.
  ExampleSteps(TrainingProgress& progress, int64_t steps) : progress_(progress), steps_(steps) {}

  // Counts the steps that are complete once `done` of `total` examples are measured.
  void Reach(int64_t done, int64_t total) {
    for (const int64_t now = steps_ * done / std::max<int64_t>(1, total); reached_ < now;
         ++reached_) {
      progress_.Step(0);
    }
  }

 private:
  TrainingProgress& progress_;
  const int64_t steps_;
  int64_t reached_ = 0;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_TRAINING_PROGRESS_H_
