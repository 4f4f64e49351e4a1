// maneuverd health: asks the server with the same options whether it is ready.

#ifndef MANEUVER_SERVER_MANEUVERD_HEALTH_COMMAND_H_
#define MANEUVER_SERVER_MANEUVERD_HEALTH_COMMAND_H_

namespace maneuver {

// Runs the command. It is for probes inside the machine or container of the server: it reads the
// same file and environment as the server, so it knows the address, and no other program is needed.
//   argv: from "health" on: options, and before or after them a service. Without a service it asks
//     about the whole server.
// Returns 0 if it serves, 1 if it does not, or does not answer within 4 s, and 2 if the options are
// wrong or the client certificate cannot be read. Prints what is wrong. A server that requires a
// client certificate gets that of MANEUVER_TLS_CERTIFICATE and MANEUVER_TLS_KEY.
int RunHealthCommand(int argc, const char* const* argv, const char* const* environment);

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_HEALTH_COMMAND_H_
