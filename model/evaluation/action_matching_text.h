// Prints a matching for people.

#ifndef MANEUVER_MODEL_EVALUATION_ACTION_MATCHING_TEXT_H_
#define MANEUVER_MODEL_EVALUATION_ACTION_MATCHING_TEXT_H_

#include <string>

#include "maneuver/v1/action_matching.pb.h"

namespace maneuver::evaluation {

// Returns a table of the pairs, closest first, and of the actions without a partner, followed by
// the figures. An action is named by its label, or by its kinematic class if it has none. Lines end
// in '\n'.
std::string ActionMatchingText(const v1::ActionMatching& matching);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ACTION_MATCHING_TEXT_H_
