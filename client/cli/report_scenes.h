// Collects the scenes of a report from the server.

#ifndef MANEUVER_CLIENT_CLI_REPORT_SCENES_H_
#define MANEUVER_CLIENT_CLI_REPORT_SCENES_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/cli/environment.h"
#include "client/report/report_data.h"

namespace maneuver::cli {

// Where a report's scenes come from.
struct SceneOrigin {
  std::string dataset;           // datasets/NAME
  v1::ExampleSettings examples;  // complete
  bool held_out = false;         // only recordings that a training with `examples` held out
};

// Asks a version about at most twelve examples of each of at most 24 recordings, spread evenly over
// the first 2,000 recordings of the dataset. Returns the examples that report::ChooseScenes picks,
// at most 24. Skips recordings that cannot be read or answered; if that is all of them, returns the
// last error. NOT_FOUND if the recordings have no examples.
absl::StatusOr<std::vector<report::Scene>> CollectScenes(const v1::ModelVersion& version,
                                                         const SceneOrigin& source,
                                                         Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_REPORT_SCENES_H_
