// Recordings from a dataset folder here or from a dataset on the server, alike.

#ifndef MANEUVER_CLIENT_CLI_SCENARIO_SOURCE_H_
#define MANEUVER_CLIENT_CLI_SCENARIO_SOURCE_H_

#include <string>

#include "absl/status/statusor.h"
#include "client/cli/environment.h"
#include "maneuver/v1/dataset_service.pb.h"

namespace maneuver::cli {

// `source` is a folder with dataset.json, or datasets/NAME.
//   most: list at most so many; 0: all.
absl::StatusOr<v1::ListScenariosResponse> ListScenarios(const std::string& source, int64_t most,
                                                        Environment& environment);
absl::StatusOr<v1::Scenario> GetScenario(const std::string& source, const std::string& scenario_id,
                                         Environment& environment);

// A recording at a glance.
v1::ScenarioSummary Summarize(const v1::Scenario& scenario);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_SCENARIO_SOURCE_H_
