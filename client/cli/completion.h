// Scripts that let a shell complete commands, options and choices; made from the tables that make
// --help.

#ifndef MANEUVER_CLIENT_CLI_COMPLETION_H_
#define MANEUVER_CLIENT_CLI_COMPLETION_H_

#include <string>

#include "client/cli/command.h"
#include "client/cli/command_entry.h"
#include "client/cli/environment.h"

namespace maneuver::cli {

// root: the program. Values without choices complete as files; options of the program are offered
// after every command.
std::string BashCompletion(const CommandEntry& root);
std::string ZshCompletion(const CommandEntry& root);
std::string FishCompletion(const CommandEntry& root);

// maneuver completion bash, zsh and fish.
//   line: whose commands are completed; outlives the run.
void AddCompletion(const CommandLine& line, Command& root, Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_COMPLETION_H_
