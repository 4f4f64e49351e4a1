// The subcommands of maneuver import, one for each format.

#ifndef MANEUVER_CLIENT_CLI_IMPORT_FORMATS_H_
#define MANEUVER_CLIENT_CLI_IMPORT_FORMATS_H_

#include "client/cli/command.h"
#include "client/cli/environment.h"

namespace maneuver::cli {

void AddImportWaymo(Command& import, Environment& environment);
void AddImportCommonRoad(Command& import, Environment& environment);
void AddImportNuScenes(Command& import, Environment& environment);
void AddImportArgoverse(Command& import, Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_IMPORT_FORMATS_H_
