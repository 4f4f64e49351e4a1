// Reads recordings from a local dataset folder or from a dataset on the server.

#ifndef MANEUVER_CLIENT_CLI_SCENARIO_SOURCE_H_
#define MANEUVER_CLIENT_CLI_SCENARIO_SOURCE_H_

#include <functional>
#include <string>

#include "absl/status/statusor.h"
#include "client/cli/environment.h"
#include "maneuver/v1/dataset_service.pb.h"

namespace maneuver::cli {

// Returns whether a source is a dataset on the server, datasets/NAME. A folder of that path here is
// ./datasets/NAME.
bool IsOnServer(const std::string& source);

// List the recordings of a source, or read one of them. Errors: NOT_FOUND for a folder that does not
// exist or has no dataset.json; those of reading a dataset folder, or of the call.
//   source: a folder with dataset.json, or datasets/NAME.
//   most: list at most this many; 0: all.
absl::StatusOr<v1::ListScenariosResponse> ListScenarios(const std::string& source, int64_t most,
                                                        Environment& environment);
absl::StatusOr<v1::Scenario> GetScenario(const std::string& source, const std::string& scenario_id,
                                         Environment& environment);

// Returns NOT_FOUND: no file or folder here has this name. If it may be the name of a dataset on the
// server, says how to name that.
absl::Status MissingSource(const std::string& source);

// Says why a source cannot be read: as Environment::FailCall if it is on the server, otherwise as
// Fail. Returns kFailed.
int FailAtSource(const std::string& source, const absl::Status& status, Environment& environment);

// Calls `visit` with each of the first `most` recordings, in order. Reads a folder once. Errors:
// those of ListScenarios and GetScenario.
absl::Status VisitScenarios(const std::string& source, int64_t most, Environment& environment,
                            const std::function<void(v1::Scenario&&)>& visit);

// Returns the summary of a recording.
v1::ScenarioSummary Summarize(const v1::Scenario& scenario);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_SCENARIO_SOURCE_H_
