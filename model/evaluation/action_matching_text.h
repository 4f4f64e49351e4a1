// Prints a matching for people.

#ifndef MANEUVER_MODEL_EVALUATION_ACTION_MATCHING_TEXT_H_
#define MANEUVER_MODEL_EVALUATION_ACTION_MATCHING_TEXT_H_

#include <span>
#include <string>

#include "maneuver/v1/action_matching.pb.h"

namespace maneuver::evaluation {

// Returns a table of the pairs, closest first, then the actions without a partner, then the
// figures. Lines end in '\n'.
//   first_names, second_names: names of each model's actions, by id. [K]
std::string ActionMatchingText(const v1::ActionMatching& matching,
                               std::span<const std::string> first_names,
                               std::span<const std::string> second_names);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ACTION_MATCHING_TEXT_H_
