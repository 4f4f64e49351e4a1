// Names in words for the actions of a model.

#ifndef MANEUVER_MODEL_EVALUATION_ACTION_NAMES_H_
#define MANEUVER_MODEL_EVALUATION_ACTION_NAMES_H_

#include <span>
#include <string>
#include <vector>

#include "maneuver/v1/evaluation.pb.h"
#include "maneuver/v1/model.pb.h"

namespace maneuver::evaluation {

inline constexpr size_t kLongestDerivedName = 40;  // characters

// Returns what each action does, in words (action_phrase.h): from its generic mean trajectory and,
// where they are known, from the classes of the examples given to it. [K]
//
// Names are unique and have at most kLongestDerivedName characters. If several actions get the same
// words, a number is added ("speed up hard, +4 m/s"), with the fewest decimals that tell them
// apart, at most two; if these do not, " (1)", " (2)" and so on. Effective actions are told apart
// as if there were no others: a single one keeps the words alone, unless they say too little
// (always_number). An action without a mean trajectory is called "action 7". The same input always
// gives the same names.
//   uses: EvaluationReport.action_uses of some examples, [K]; empty if there are none
std::vector<std::string> NameActions(const v1::ModelManifest& manifest,
                                     std::span<const v1::ActionUse> uses = {});

// Returns the name of each action to show to people: its label, else its derived name. If an action
// has no derived name, because an older release exported the version, all names are derived from
// the generic means alone. [K], even if the manifest lists no actions
std::vector<std::string> DisplayNames(const v1::ModelManifest& manifest);

// Sets display_name, and derived_name where one is missing, of every action, as DisplayNames does.
void CompleteActionNames(v1::ModelManifest& manifest);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ACTION_NAMES_H_
