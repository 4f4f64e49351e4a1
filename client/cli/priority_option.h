// The option --priority of commands that ask for predictions.

#ifndef MANEUVER_CLIENT_CLI_PRIORITY_OPTION_H_
#define MANEUVER_CLIENT_CLI_PRIORITY_OPTION_H_

#include <string>

#include "client/cli/command.h"
#include "maneuver/v1/prediction_service.pb.h"

namespace maneuver::cli {

inline void AddPriorityOption(Command& command, std::string* priority) {
  command.Choice("--priority", priority, {"interactive", "bulk"},
                 "bulk: let interactive requests go first");
}

inline v1::Priority PriorityNamed(const std::string& name) {
  return name == "bulk" ? v1::PRIORITY_BULK : v1::PRIORITY_INTERACTIVE;
}

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_PRIORITY_OPTION_H_
