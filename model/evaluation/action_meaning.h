// What actions mean: how well they agree with classes of trajectories that training never used.

#ifndef MANEUVER_MODEL_EVALUATION_ACTION_MEANING_H_
#define MANEUVER_MODEL_EVALUATION_ACTION_MEANING_H_

#include <span>

#include "maneuver/v1/training_service.pb.h"
#include "model/evaluation/measurement.h"

namespace maneuver::evaluation {

// An action gets a name if at least this share of its examples is of one relative class.
inline constexpr double kNamedPurity = 0.7;

// Sets the agreement of actions (argmax q(y|x,s)) with recorded manoeuvres, kinematic classes and
// relative classes, under the names of evaluator.h, and the classes in `action_uses`.
//   report: must have one element of action_uses for each action.
void AddMeaning(std::span<const Measurement> measured, v1::EvaluationReport& report);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ACTION_MEANING_H_
