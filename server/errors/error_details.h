// Machine-readable details on absl::Status: google.rpc.ErrorInfo, BadRequest and RetryInfo,
// serialised as payloads under google.rpc's own type URLs. Folders without gRPC attach them;
// rpc/status_details.h puts them on the wire. No error is translated twice.

#ifndef MANEUVER_SERVER_ERRORS_ERROR_DETAILS_H_
#define MANEUVER_SERVER_ERRORS_ERROR_DETAILS_H_

#include <chrono>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "model/scene/field_violation.h"
#include "server/errors/reasons.h"

namespace maneuver::v1 {
class Status;
}

namespace maneuver::errors {

// The most violations that one error lists. Errors travel in headers, whose size clients limit.
inline constexpr size_t kMaxListedViolations = 16;

// Returns INVALID_ARGUMENT with the reason INVALID_FIELD and a BadRequest that lists the first
// kMaxListedViolations. The message names the first violation and counts the others.
//   prefix: path of the message that contains the violations ("scenarios[2]"), put before each
//     field; empty for none.
absl::Status InvalidFields(const std::vector<scene::FieldViolation>& violations,
                           std::string_view prefix = {});
// Returns the same for one field.
absl::Status InvalidField(std::string_view field, std::string_view description);

// Returns INVALID_ARGUMENT with the reason MALFORMED_MESSAGE: the bytes of a request do not parse.
absl::Status MalformedMessage();

// Adds an ErrorInfo with a reason from reasons.h to `status`. Replaces an earlier one.
absl::Status WithReason(absl::Status status, Reason reason,
                        const std::map<std::string, std::string>& metadata = {});
// Returns the reason that WithReason added; empty if there is none.
std::string ReasonOf(const absl::Status& status);

// Maps a failure of the disk or of the database to what a caller should see: DISK_FULL for
// RESOURCE_EXHAUSTED, STORAGE_DAMAGED for DATA_LOSS, INTERNAL with STORAGE_INACCESSIBLE for
// PERMISSION_DENIED, which would otherwise blame the caller, and FOLDER_UNAVAILABLE as
// WithFolderReason does. Leaves other statuses, and those with a reason, unchanged.
absl::Status WithStorageReason(absl::Status status);

// Returns UNAVAILABLE with the reason FOLDER_UNAVAILABLE, the name of a part of the data folder
// and a retry delay, if `status` says that the file system of a file failed (files::ErrnoStatus).
// Leaves other statuses, and those with a reason, unchanged.
absl::Status WithFolderReason(absl::Status status, std::string_view folder);

// Returns whether a call failed because the database of jobs and aliases cannot be used at the
// moment (STORE_UNAVAILABLE): it will succeed later. The store has logged that.
bool IsStoreAway(const absl::Status& status);

// Adds a RetryInfo to `status`.
absl::Status WithRetryDelay(absl::Status status, std::chrono::nanoseconds delay);
// Returns the delay that WithRetryDelay added; nullopt if there is none.
std::optional<std::chrono::nanoseconds> RetryDelay(const absl::Status& status);

// Converts a failed status to its form on the wire. Details are in the order ErrorInfo, BadRequest,
// RetryInfo.
v1::Status ToProto(const absl::Status& status);
// Converts back. An unknown code becomes UNKNOWN; details of other types are dropped.
absl::Status FromProto(const v1::Status& status);

}  // namespace maneuver::errors

#endif  // MANEUVER_SERVER_ERRORS_ERROR_DETAILS_H_
