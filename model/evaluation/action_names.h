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
// Names differ from each other and have at most kLongestDerivedName characters. Among actions of the
// same words the only effective one bears them alone; the others bear their number too, with as few
// decimals as tell them apart. An action without a mean trajectory is called "action 7". The same
// input always has the same names.
//   uses: EvaluationReport.action_uses of some examples, [K]; empty: nothing is known of them
std::vector<std::string> NameActions(const v1::ModelManifest& manifest,
                                     std::span<const v1::ActionUse> uses = {});

// Returns what to show to people of each action: the label, else the derived name. Where no action
// has a derived name, as in versions that were exported before there were names, they are made from
// the generic means alone. [K], also of a manifest that has no actions
std::vector<std::string> DisplayNames(const v1::ModelManifest& manifest);

// Sets the derived_name of every action, if none has one, and display_name, as DisplayNames does.
void CompleteActionNames(v1::ModelManifest& manifest);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ACTION_NAMES_H_
