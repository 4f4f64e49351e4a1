// Writes answers of the server as JSON.

#ifndef MANEUVER_CLIENT_CLI_ANSWER_JSON_H_
#define MANEUVER_CLIENT_CLI_ANSWER_JSON_H_

#include <google/protobuf/message.h>

#include <string>

#include "absl/status/statusor.h"

namespace maneuver::cli {

// Returns `message` as indented proto3 JSON, with fields that are 0 or empty. Details of errors are
// written out, each with the name of its type in google.rpc as "@type". INTERNAL if the message
// contains an Any of another type that this program does not know.
absl::StatusOr<std::string> ToAnswerJson(const google::protobuf::Message& message);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_ANSWER_JSON_H_
