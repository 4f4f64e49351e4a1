// Reads the scenes of a request from files.

#ifndef MANEUVER_CLIENT_CLI_SCENARIO_FILES_H_
#define MANEUVER_CLIENT_CLI_SCENARIO_FILES_H_

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/command.h"
#include "client/cli/environment.h"
#include "maneuver/v1/prediction_service.pb.h"

namespace maneuver::cli {

// Reads one Scenario from each file ("-": standard input). INVALID_ARGUMENT if one names no target;
// otherwise the errors of ReadJson.
absl::StatusOr<std::vector<v1::Scenario>> ReadScenarios(const std::vector<std::string>& files,
                                                        Environment& environment);

// Returns a name such as "town-1-0 target 12", for tables and errors.
std::string TargetName(const std::string& scenario_id, int64_t target_id);

// Prints why one item of a batch failed. `item` is its name, or empty.
void ReportItemError(const std::string& item, const v1::Status& error, Environment& environment);

// Prints the warnings about a scene that was answered nevertheless. --quiet silences them.
using SceneWarnings = google::protobuf::RepeatedPtrField<v1::SceneWarning>;
void ReportWarnings(const std::string& item, const SceneWarnings& warnings,
                    Environment& environment);

// Adds --strict: scenes that look wrong are refused instead of answered with warnings.
void AddStrictOption(Command& command, bool* strict);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_SCENARIO_FILES_H_
