// maneuverd store migrate, check and copy: the database of jobs and aliases, while no server runs.

#ifndef MANEUVER_SERVER_MANEUVERD_STORE_COMMAND_H_
#define MANEUVER_SERVER_MANEUVERD_STORE_COMMAND_H_

namespace maneuver {

// Runs the command for the server whose options it is given, by command line, environment and file.
// Prints what it did.
//   argv: from "store" on.
//   environment: ends with nullptr, as environ does.
// Returns the exit status: 0, 1 if it failed, 2 if the command line is wrong.
int RunStoreCommand(int argc, const char* const* argv, const char* const* environment);

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_STORE_COMMAND_H_
