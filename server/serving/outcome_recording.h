// Turns an outcome into a recording that models can learn from.

#ifndef MANEUVER_SERVER_SERVING_OUTCOME_RECORDING_H_
#define MANEUVER_SERVER_SERVING_OUTCOME_RECORDING_H_

#include <set>

#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/outcome_service.pb.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::serving {

// The prediction time of all these recordings, seconds: a multiple of every usual stride, so that
// an example lies there.
inline constexpr double kOutcomeTime = 60.0;

// Returns what the model saw of the scene, and then what the targets did up to the model's horizon.
//   Agents: those that are not targets end at the prediction time, so they make no examples.
//   Past: as long as the model's window, so two outcomes of one drive teach nothing twice.
//   Times: shifted so that the prediction time is kOutcomeTime.
//   Id: "{drive}#{digest}", the scene's id without its part and a digest of the content. The drive
//     is "outcome" if the scene's is empty or longer than 100 bytes.
//   outcome: has a scenario, valid
//   targets: those whose outcomes were scored, at least one
v1::Scenario OutcomeRecording(const v1::Outcome& outcome, const std::set<int64_t>& targets,
                              const v1::ModelSpec& spec);

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_OUTCOME_RECORDING_H_
