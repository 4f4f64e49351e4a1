// maneuverd health: asks the server that these options start whether it is ready.

#ifndef MANEUVER_SERVER_MANEUVERD_HEALTH_COMMAND_H_
#define MANEUVER_SERVER_MANEUVERD_HEALTH_COMMAND_H_

namespace maneuver {

// For probes of the machine or container that the server runs in: it reads the same file and
// environment as the server, so it knows where to ask, and needs no other program there.
//   argv: from "health" on; then options, and before or after them a service, if not the whole
//     server is meant.
// 0: it serves, 1: it does not, 2: the options are wrong. What is wrong was printed.
int RunHealthCommand(int argc, const char* const* argv, const char* const* environment);

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_HEALTH_COMMAND_H_
