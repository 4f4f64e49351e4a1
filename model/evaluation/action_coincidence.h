// Whether two models call the same recorded trajectories the same action.

#ifndef MANEUVER_MODEL_EVALUATION_ACTION_COINCIDENCE_H_
#define MANEUVER_MODEL_EVALUATION_ACTION_COINCIDENCE_H_

#include <cstdint>
#include <map>
#include <utility>

#include "absl/status/statusor.h"
#include "maneuver/v1/action_matching.pb.h"
#include "model/evaluation/evaluator.h"
#include "model/inference/action_model.h"

namespace maneuver::evaluation {

// Pairs the actions of two models as action_matching.h does, with their shares over the examples of
// `input`. Also measures how far the models agree on the action of each example, argmax q(y|x,s).
// Errors: also those of Evaluate.
absl::StatusOr<v1::ActionMatching> MeasureMatching(const inference::ActionModel& first,
                                                   const inference::ActionModel& second,
                                                   const EvaluationInput& input);

// How many examples have each pair of actions, one of each model.
using ActionPairs = std::map<std::pair<int, int>, int64_t>;

// Returns the normalised mutual information over these examples, and the share whose actions are
// one of the matching's pairs.
v1::ActionCoincidence CoincidenceOf(const ActionPairs& pairs, const v1::ActionMatching& matching);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ACTION_COINCIDENCE_H_
