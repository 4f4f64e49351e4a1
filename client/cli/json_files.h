// Reads and writes messages as proto3 JSON.

#ifndef MANEUVER_CLIENT_CLI_JSON_FILES_H_
#define MANEUVER_CLIENT_CLI_JSON_FILES_H_

#include <google/protobuf/message.h>

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/environment.h"

namespace maneuver::cli {

// Reads one message from `path`, or from standard input if that is "-". INVALID_ARGUMENT names the
// file if it does not parse.
absl::Status ReadJson(const std::string& path, Environment& environment,
                      google::protobuf::Message* message);

// Returns the JSON without fields that have their default value.
std::string ToCompactJson(const google::protobuf::Message& message);

// Writes bytes to a file, replacing it. FAILED_PRECONDITION names the path and the reason.
absl::Status WriteFile(const std::string& path, const std::string& content);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_JSON_FILES_H_
