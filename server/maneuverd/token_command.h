// maneuverd token create: makes a token that lets its holder call the server.

#ifndef MANEUVER_SERVER_MANEUVERD_TOKEN_COMMAND_H_
#define MANEUVER_SERVER_MANEUVERD_TOKEN_COMMAND_H_

namespace maneuver {

//   argv: from "token" on.
// The exit status; what happened was printed.
int RunTokenCommand(int argc, char** argv);

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_TOKEN_COMMAND_H_
