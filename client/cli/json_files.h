// Reads and writes messages as proto3 JSON.

#ifndef MANEUVER_CLIENT_CLI_JSON_FILES_H_
#define MANEUVER_CLIENT_CLI_JSON_FILES_H_

#include <google/protobuf/message.h>

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/environment.h"

namespace maneuver::cli {

// Reads all of a file, or of standard input if `path` is "-", without a byte order mark. NOT_FOUND if it cannot be read,
// INVALID_ARGUMENT if it has more than 1 GiB.
absl::StatusOr<std::string> ReadText(const std::string& path, Environment& environment);

// Parses one message from the text of the file `path`. INVALID_ARGUMENT, naming the file, if the
// text does not parse.
absl::Status ParseJson(const std::string& text, const std::string& path,
                       google::protobuf::Message* message);

// Reads one message from `path`, or from standard input if that is "-". Errors: those of
// ReadText and ParseJson.
absl::Status ReadJson(const std::string& path, Environment& environment,
                      google::protobuf::Message* message);

// Returns the JSON without fields that have their default value.
std::string ToCompactJson(const google::protobuf::Message& message);

// Writes bytes to a file, replacing it. FAILED_PRECONDITION names the path and the reason.
absl::Status WriteFile(const std::string& path, const std::string& content);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_JSON_FILES_H_
