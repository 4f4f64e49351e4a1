// maneuverd repair: brings a damaged database of jobs and aliases back, while no server runs.

#ifndef MANEUVER_SERVER_MANEUVERD_REPAIR_COMMAND_H_
#define MANEUVER_SERVER_MANEUVERD_REPAIR_COMMAND_H_

namespace maneuver {

// Runs "repair [OPTIONS]". Returns the exit status: 0, 1 if it failed, 2 if the command line is
// wrong.
//   argv[0]: "repair"
//   environment: ends with nullptr, as environ does.
int RunRepairCommand(int argc, const char* const* argv, const char* const* environment);

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_REPAIR_COMMAND_H_
