// maneuver model export: writes a model's networks to an ONNX file for other engines.

#ifndef MANEUVER_CLIENT_CLI_MODEL_EXPORT_H_
#define MANEUVER_CLIENT_CLI_MODEL_EXPORT_H_

#include "client/cli/command.h"
#include "client/cli/environment.h"

namespace maneuver::cli {

void AddModelExport(Command& group, Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_MODEL_EXPORT_H_
