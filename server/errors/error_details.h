// Machine-readable details on absl::Status: the bytes of google.rpc.ErrorInfo, BadRequest and
// RetryInfo as payloads, under google.rpc's own type URLs. Plain C++ folders attach them; rpc/ puts
// them on the wire (rpc/status_details.h), so nobody has to translate errors twice.

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

// The most violations that an error lists: errors travel in headers, which clients bound.
inline constexpr size_t kMaxListedViolations = 16;

// INVALID_ARGUMENT with a BadRequest, which lists the first kMaxListedViolations. The message names
// the first violation and counts the others.
//   prefix: path of the message that the violations were found in ("scenarios[2]"), put before each
//   field; empty for none.
absl::Status InvalidFields(const std::vector<scene::FieldViolation>& violations,
                           std::string_view prefix = {});
absl::Status InvalidField(std::string_view field, std::string_view description);

// `status` with an ErrorInfo: a reason of the table in reasons.h. Replaces an earlier one.
absl::Status WithReason(absl::Status status, Reason reason,
                        const std::map<std::string, std::string>& metadata = {});
// The reason that WithReason gave; empty if there is none.
std::string ReasonOf(const absl::Status& status);

// What a failure of the disk or of the database tells a caller: DISK_FULL for RESOURCE_EXHAUSTED,
// STORAGE_DAMAGED for DATA_LOSS, and INTERNAL with STORAGE_INACCESSIBLE for PERMISSION_DENIED,
// which would blame the caller. Anything else, and what has a reason already, stays as it is.
absl::Status WithStorageReason(absl::Status status);

// `status` with a RetryInfo.
absl::Status WithRetryDelay(absl::Status status, std::chrono::nanoseconds delay);
std::optional<std::chrono::nanoseconds> RetryDelay(const absl::Status& status);

// A failed status as the wire states it, details in the order ErrorInfo, BadRequest, RetryInfo.
v1::Status ToProto(const absl::Status& status);
// The other way. An unknown code becomes UNKNOWN, details of other types are dropped.
absl::Status FromProto(const v1::Status& status);

}  // namespace maneuver::errors

#endif  // MANEUVER_SERVER_ERRORS_ERROR_DETAILS_H_
