// Reads the scenes that the calls of a load run ask about.

#ifndef MANEUVER_CLIENT_CLI_LOAD_SCENES_H_
#define MANEUVER_CLIENT_CLI_LOAD_SCENES_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/cli/environment.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::cli {

struct LoadScenes {
  std::vector<std::string> files;  // scenarios as proto3 JSON; if empty:
  std::string source;              // a dataset, here or on the server; if empty: the synthetic town
  int most = 32;                   // scenes of a dataset or the town
  int most_targets = 1;            // wanted in each scene; it may have fewer or more
  uint64_t seed = 1;               // of the town
};

// Returns scenes with at least one target each. NOT_FOUND if there is none; other errors: those of
// ReadScenarios for files, of VisitScenarios (scenario_source.h) for a dataset.
absl::StatusOr<std::vector<v1::Scenario>> ReadLoadScenes(const LoadScenes& wanted,
                                                         Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_LOAD_SCENES_H_
