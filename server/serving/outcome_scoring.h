// Scores an answer against what its target did.

#ifndef MANEUVER_SERVER_SERVING_OUTCOME_SCORING_H_
#define MANEUVER_SERVER_SERVING_OUTCOME_SCORING_H_

#include <array>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/evaluation/measurement.h"
#include "model/inference/action_model.h"
#include "server/serving/past_answers.h"

namespace maneuver::serving {

using AgentStates = google::protobuf::RepeatedPtrField<v1::AgentState>;

// The metrics of an outcome, named as in evaluation/evaluator.h, whose figures are their means.
inline constexpr std::array<std::string_view, 7> kOutcomeMetrics = {
    "ade_1", "fde_1", "min_ade_6", "min_fde_6", "nll", "coverage_1sigma", "coverage_2sigma"};

// One scored answer.
struct ScoredOutcome {
  evaluation::Measurement measurement;  // as evaluation::MeasureAnswer sets it; of keys, what
                                        // PastAnswer has
  std::array<double, kOutcomeMetrics.size()> metrics{};  // finite
  std::string_view speed_stratum;                        // a name of evaluation::Stratifications()
};

// Scores an answer.
//   states: of the target after the prediction time, world frame
//   model: the version that answered;  session: one of its sessions
//   path: of the message that contains the states, for field paths
// INVALID_ARGUMENT, with the field:
//   - There is no state, a state breaks the limits of a scenario, or the times do not increase.
//   - The first state is not after the prediction time.
//   - The target moves faster than an agent of its type can (data::MostSpeed; at most 100 m/s).
//   - The states do not reach the model's horizon, or leave a gap.
// INTERNAL, reason ANSWER_UNSOUND: a score is not finite.
absl::StatusOr<ScoredOutcome> ScoreOutcome(const PastAnswer& answer, const AgentStates& states,
                                           const inference::ActionModel& model,
                                           inference::InferenceSession& session,
                                           const std::string& path);

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_OUTCOME_SCORING_H_
