// Measures what a step of a phase takes, before the phase begins.

#ifndef MANEUVER_MODEL_LEARNING_PHASES_REHEARSAL_H_
#define MANEUVER_MODEL_LEARNING_PHASES_REHEARSAL_H_

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "model/learning/phases/epoch_loop.h"
#include "model/learning/phases/learning_state.h"
#include "model/learning/run_progress.h"

namespace maneuver::learning {

using PhaseFunction = absl::Status (*)(LearningState&, EpochLoop&);

// Runs one short epoch of the phase, some 2 % of its steps and one validation, and returns the
// seconds of a step. They include the step's share of the validation that ends an epoch. Leaves
// `state` as it was. Returns nothing if the phase is too short for that, if it fails, or if the run
// is asked to stop; the phase itself then says why.
//   phase: as planned;  batch_size: of its steps
//   clock: measures the time
std::optional<double> RehearseStep(const RunProgress::Phase& phase, int64_t batch_size,
                                   PhaseFunction learn, LearningState& state,
                                   const RunProgress::Clock& clock);

// Returns the plan with costs in seconds. They are those that were measured (by the phase's name, of
// a step), and for other phases the planned cost, on the scale of pretraining before the joint phase,
// and on the scale of the joint phase from there on. Returns the plan as it is if the joint phase
// was not measured.
std::vector<RunProgress::Phase> WithMeasuredSteps(std::vector<RunProgress::Phase> plan,
                                                  const std::map<std::string, double>& measured);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PHASES_REHEARSAL_H_
