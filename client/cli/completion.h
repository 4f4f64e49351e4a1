// Shell scripts that complete commands, options and choices. They are made from the same tables as
// --help.

#ifndef MANEUVER_CLIENT_CLI_COMPLETION_H_
#define MANEUVER_CLIENT_CLI_COMPLETION_H_

#include <string>

#include "client/cli/command.h"
#include "client/cli/command_entry.h"
#include "client/cli/environment.h"

namespace maneuver::cli {

// Return the script for one shell. Values without choices complete as files. Options of the program
// are offered after every command.
//   root: the program.
std::string BashCompletion(const CommandEntry& root);
std::string ZshCompletion(const CommandEntry& root);
std::string FishCompletion(const CommandEntry& root);

// Adds the commands `maneuver completion bash`, `zsh` and `fish`.
//   line: the command line to complete; must outlive the run.
void AddCompletion(const CommandLine& line, Command& root, Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_COMPLETION_H_
