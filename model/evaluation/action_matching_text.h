// A matching as people read it.

#ifndef MANEUVER_MODEL_EVALUATION_ACTION_MATCHING_TEXT_H_
#define MANEUVER_MODEL_EVALUATION_ACTION_MATCHING_TEXT_H_

#include <string>

#include "maneuver/v1/action_matching.pb.h"

namespace maneuver::evaluation {

// A table of the pairs, closest first, with what is left over; then the figures. Names of actions
// are their labels, or their kinematic class where they have none. Lines end in '\n'.
std::string ActionMatchingText(const v1::ActionMatching& matching);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ACTION_MATCHING_TEXT_H_
