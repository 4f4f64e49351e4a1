// Whether two models call the same recorded trajectories the same action.

#ifndef MANEUVER_MODEL_EVALUATION_ACTION_COINCIDENCE_H_
#define MANEUVER_MODEL_EVALUATION_ACTION_COINCIDENCE_H_

#include <span>

#include "absl/status/statusor.h"
#include "maneuver/v1/action_matching.pb.h"
#include "model/evaluation/evaluator.h"
#include "model/inference/action_model.h"

namespace maneuver::evaluation {

// MatchActions (action_matching.h) with shares over the examples of the recordings, and how far the
// models agree there on which action each example was, argmax q(y|x,s). Errors: also those of
// MeasureExamples.
absl::StatusOr<v1::ActionMatching> MatchActions(const inference::ActionModel& first,
                                                const inference::ActionModel& second,
                                                const EvaluationInput& input);

// Over examples whose actions are `first` and `second`, [N] each: normalised mutual information,
// and the share whose actions are one of the pairs.
v1::ActionCoincidence CoincidenceOf(std::span<const int> first, std::span<const int> second,
                                    const v1::ActionMatching& matching);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ACTION_COINCIDENCE_H_
