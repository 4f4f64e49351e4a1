// Names of actions, and which action of one version corresponds to which of another.

#ifndef MANEUVER_CLIENT_CLI_ACTION_TITLES_H_
#define MANEUVER_CLIENT_CLI_ACTION_TITLES_H_

#include <google/protobuf/repeated_field.h>

#include <string>
#include <vector>

#include "client/cli/command.h"
#include "client/cli/environment.h"
#include "maneuver/v1/model.pb.h"

namespace maneuver::cli {

// Action names that a server returned, by action id. [K], or empty
using ActionTitles = google::protobuf::RepeatedPtrField<std::string>;

// Returns the name of an action as a table shows it; empty if there is none.
std::string TitleOf(const ActionTitles& titles, int action_id);

// Returns the display names of a version's actions, by id; empty if the server does not give them.
std::vector<std::string> FetchActionNames(const std::string& model_version,
                                          Environment& environment);

// Adds --require-name, which may be repeated.
void AddRequireNameOption(Command& command, std::vector<std::string>* names);

// Returns a table of the corresponding actions of `before` and `after`, in the order of the ids of
// `before`; actions without a partner come last. They are matched as by maneuver-trainer
// match-actions without a dataset. If they cannot be matched, returns a line that says why. Lines
// end in '\n'.
std::string ActionMappingText(const v1::ModelVersion& before, const v1::ModelVersion& after,
                              bool color);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_ACTION_TITLES_H_
