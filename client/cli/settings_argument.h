// Training settings from the command line.

#ifndef MANEUVER_CLIENT_CLI_SETTINGS_ARGUMENT_H_
#define MANEUVER_CLIENT_CLI_SETTINGS_ARGUMENT_H_

#include <google/protobuf/message.h>

#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/environment.h"
#include "maneuver/v1/training_settings.pb.h"

namespace maneuver::cli {

// Sets one field. The field is named by its dotted path, for example
// "optimization.joint_epochs=20", "model.decoder.hidden=500,500",
// "model.target_types=pedestrian,cyclist" or "examples.stride=0.5s". A list replaces the whole
// list. Durations may omit the "s", and enumeration values their prefix. Messages are written as
// proto3 JSON. INVALID_ARGUMENT lists the fields that exist, or says what the field accepts.
absl::Status SetField(const std::string& assignment, google::protobuf::Message* message);

// Sets a field of ExampleSettings, as SetField does. `assignment` may begin with "examples.", as in
// TrainingSettings: "examples.stride=1s" and "stride=1s" are the same.
absl::Status SetExampleField(const std::string& assignment, v1::ExampleSettings* examples);

// Returns FIELD=0 for each number that TrainingSettings in proto3 JSON gives as 0, for
// RefuseUnheardZeros: a message does not keep them. Empty for text that is not JSON.
std::vector<std::string> ZerosOfSettings(const std::string& json);

// Refuses zeros that the server could not tell from unset fields: it would use the preset's value.
// INVALID_ARGUMENT names the field and that value.
//   assignments: FIELD=VALUE, all of which SetField has accepted or ZerosOfSettings returned.
//   settings: the result of these assignments.
absl::Status RefuseUnheardZeros(const std::vector<std::string>& assignments,
                                const v1::TrainingSettings& settings);

// Reads settings from a file with TrainingSettings as proto3 JSON, if one is given, then sets the
// fields of `assignments` in their order. Errors: those of ReadText and ParseJson, of SetField and
// of RefuseUnheardZeros.
absl::StatusOr<v1::TrainingSettings> ReadSettings(const std::optional<std::string>& file,
                                                  std::vector<std::string> assignments,
                                                  Environment& environment);

// Returns training settings with these examples and every default. INVALID_ARGUMENT names the first
// wrong field.
absl::StatusOr<v1::TrainingSettings> ResolveExamples(const v1::ExampleSettings& examples);

// Sets the number of waypoints that a horizon takes, at the waypoint interval of the settings or of
// their preset. INVALID_ARGUMENT if the horizon is not a whole number of intervals.
//   horizon: seconds, "5s" or "5".
absl::Status SetHorizon(const std::string& horizon, v1::TrainingSettings* settings);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_SETTINGS_ARGUMENT_H_
