// The command `maneuver`, as a function.

#ifndef MANEUVER_CLIENT_CLI_MANEUVER_H_
#define MANEUVER_CLIENT_CLI_MANEUVER_H_

#include <string>
#include <vector>

#include "client/cli/environment.h"

namespace maneuver::cli {

// Runs one command line (without the program's name); returns its exit status: see ExitCode.
int RunManeuver(const std::vector<std::string>& arguments, Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_MANEUVER_H_
