// Measures how long a step of a phase takes, before the phase begins.

#ifndef MANEUVER_MODEL_LEARNING_PHASES_REHEARSAL_H_
#define MANEUVER_MODEL_LEARNING_PHASES_REHEARSAL_H_

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "model/artifact/calibration_examples.h"
#include "model/learning/calibration_steps.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"
#include "model/learning/training_progress.h"

namespace maneuver::learning {

// A phase that can be rehearsed.
struct RehearsedPhase {
  std::string name;        // in the plan
  int64_t batch_size = 0;  // of its steps
  // Learns for an epoch or more. Changes nothing but the state.
  std::function<absl::Status(LearningState&, EpochLoop&)> learn;
  int ranks = 1;  // that learn it together
};

// Runs one short epoch of the phase, a fortieth of its steps (4 to 40) and one validation, and
// returns the seconds of a step. They include the step's share of the validation that ends an
// epoch. Leaves `state` as it was. Returns nothing if the phase is too short for that (fewer than
// 100 steps), if it fails, or if the run is asked to stop; the phase itself then says why. This
// process rehearses alone. For a phase that ranks share, it divides the time of a whole step by
// their number. The time of their exchanges is not included.
//   planned: the phase in the plan
//   clock: measures the time
std::optional<double> RehearseStep(const TrainingProgress::Phase& planned,
                                   const RehearsedPhase& phase, LearningState& state,
                                   const TrainingProgress::Clock& clock);

// A calibration that can be rehearsed.
struct RehearsedCalibration {
  std::string name;                        // in the plan
  artifact::CalibrationExamples examples;  // of the whole calibration
  CalibrationPlan steps;                   // that it takes
  // Calibrates by at most so many examples. Changes nothing but the state.
  std::function<absl::Status(const artifact::CalibrationExamples& most,
                             const CountCalibrationStep& count)>
      calibrate;
};

// Calibrates by a tenth of the examples, but at least kFewestHeldOut of each source, on the
// networks as they are, and returns the seconds of each kind of step. Leaves `state` as it was.
// Returns nothing if there are fewer than 400 held-out examples, if it fails, or if the run is
// asked to stop.
std::optional<std::vector<double>> RehearseCalibration(const RehearsedCalibration& calibration,
                                                       LearningState& state,
                                                       const TrainingProgress::Clock& clock);

// Seconds of a step, by the phase's name, of each kind.
using MeasuredSteps = std::map<std::string, std::vector<double>>;

// What follows the phases of a learner.
struct LaterPhases {
  std::vector<RehearsedPhase> learned = {};
  std::vector<RehearsedCalibration> calibrated = {};
  // Rehearses phases of other sorts and adds their steps. May be empty.
  std::function<void(MeasuredSteps*)> rehearse_others = nullptr;
};

// Returns the plan with costs in seconds a step. A phase in `measured` gets its measured costs, and
// one whose `seconds` are known gets those. Other phases get their planned costs times a factor:
// the measured / planned cost of pretraining for the phases between it and the joint phase, if
// pretraining was measured, and that of the joint phase for all others. Returns the plan unchanged
// if the joint phase was not measured.
std::vector<TrainingProgress::Phase> WithMeasuredSteps(std::vector<TrainingProgress::Phase> plan,
                                                       const MeasuredSteps& measured);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_REHEARSAL_H_
