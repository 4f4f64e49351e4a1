// Prints the comparison of a model with its rivals for people.

#ifndef MANEUVER_MODEL_EVALUATION_RIVAL_TEXT_H_
#define MANEUVER_MODEL_EVALUATION_RIVAL_TEXT_H_

#include <string>
#include <string_view>

#include "maneuver/v1/rivals.pb.h"

namespace maneuver::evaluation {

// Returns "ahead", "BEHIND" or "?".
std::string_view VerdictMark(v1::RivalVerdict verdict);

// Returns one table by ade_1. Below it, one sentence per rival says in how many strata the model is
// ahead of it, and where it is behind. Trained rivals also have a sentence by min_ade_6. A legend
// follows. Sentences wrap at 100 columns; lines end in '\n'. Empty if nothing was compared. The
// standings themselves have all metrics and intervals.
std::string RivalText(const v1::RivalStandings& standings, bool color);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_RIVAL_TEXT_H_
