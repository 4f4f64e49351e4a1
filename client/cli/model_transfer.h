// The commands `maneuver model pull` and `push`, which copy versions from and to servers.

#ifndef MANEUVER_CLIENT_CLI_MODEL_TRANSFER_H_
#define MANEUVER_CLIENT_CLI_MODEL_TRANSFER_H_

#include "client/cli/command.h"
#include "client/cli/environment.h"

namespace maneuver::cli {

void AddModelTransfer(Command& group, Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_MODEL_TRANSFER_H_
