// Reads what a failed call says beyond its code and message.
//
// Calls of this library fail with an absl::Status. The machine-readable details that the server
// sent (grpc-status-details-bin) are its payloads. ErrorDetailsOf reads them:
//
//   absl::StatusOr<v1::Job> job = client->Train(request);
//   if (!job.ok()) {
//     const client::ErrorDetails details = client::ErrorDetailsOf(job.status());
//     if (details.reason == "DATASET_NOT_FOUND") ...
//     for (const client::FieldViolation& violation : details.field_violations) ...
//   }

#ifndef MANEUVER_CLIENT_ERROR_DETAILS_H_
#define MANEUVER_CLIENT_ERROR_DETAILS_H_

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "maneuver/v1/status.pb.h"

namespace maneuver::client {

// The reason of a prediction that the library did not send (ClientOptions::hold_back).
inline constexpr char kHeldBack[] = "HELD_BACK";

// An invalid field of the request.
struct FieldViolation {
  std::string field;        // path within the request: scenarios[2].agents[0].states[5].x
  std::string description;  // what is wrong with it
};

// The google.rpc.ErrorInfo, BadRequest and RetryInfo of one error; empty where the server sent
// none.
struct ErrorDetails {
  std::string reason = {};                           // stable, UPPER_SNAKE_CASE
  std::map<std::string, std::string> metadata = {};  // more about the reason
  std::vector<FieldViolation> field_violations = {};
  // With the reason ACTION_NAME_GONE: the required names that no action has (the first 16).
  std::vector<std::string> missing_action_names = {};
  std::optional<absl::Duration> retry_delay = {};  // wait at least this long before trying again
};

// Returns the details of a failed call.
ErrorDetails ErrorDetailsOf(const absl::Status& status);

// Returns the details of one failed item of a batch, or of a failed job.
ErrorDetails ErrorDetailsOf(const v1::Status& status);

// Adds details to a status as a server would. Leaves out empty ones.
absl::Status WithDetails(absl::Status status, const ErrorDetails& details);

// Returns the error of an item or a job as a status, with its details as payloads. OK for code 0.
absl::Status ToStatus(const v1::Status& status);

// Builds the status of a call from its parts on the wire.
//   details_bin: value of grpc-status-details-bin, a serialised google.rpc.Status; may be empty.
// Ignores details that do not parse, so that they never hide the error itself.
absl::Status StatusFromWire(int code, std::string_view message, std::string_view details_bin);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_ERROR_DETAILS_H_
