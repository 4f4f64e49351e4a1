// maneuver import: makes datasets of recordings in other formats.

#include "client/cli/commands.h"
#include "client/cli/import_formats.h"

namespace maneuver::cli {

void AddImport(Command& root, Environment& environment) {
  Command import = root.Add("import", "Make a dataset of recordings in another format");
  AddImportWaymo(import, environment);
  AddImportCommonRoad(import, environment);
  AddImportNuScenes(import, environment);
  AddImportArgoverse(import, environment);
}

}  // namespace maneuver::cli
