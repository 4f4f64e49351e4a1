// maneuverd token create, list and revoke: who may call the server.

#ifndef MANEUVER_SERVER_MANEUVERD_TOKEN_COMMAND_H_
#define MANEUVER_SERVER_MANEUVERD_TOKEN_COMMAND_H_

#include "absl/time/time.h"

namespace maneuver {

// Runs the command on the tokens file that it names. Prints what it did; tokens go to standard
// output.
//   argv: from "token" on.
//   now: the present time, for expiry.
// Returns the exit status: 0, 1 if it failed, 2 if the command line is wrong.
int RunTokenCommand(int argc, const char* const* argv, absl::Time now);

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_TOKEN_COMMAND_H_
