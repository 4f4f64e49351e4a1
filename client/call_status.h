// Private to the library: converts the end of a gRPC call to an absl::Status.

#ifndef MANEUVER_CLIENT_CALL_STATUS_H_
#define MANEUVER_CLIENT_CALL_STATUS_H_

#include <grpcpp/support/status.h>

#include "absl/status/status.h"
#include "client/cancellation.h"
#include "client/error_details.h"

namespace maneuver::client {

// Keeps the code, the message and the details.
inline absl::Status ToStatus(const grpc::Status& status) {
  return StatusFromWire(status.error_code(), status.error_message(), status.error_details());
}

// Converts the end of a call that may be repeated. CANCELLED without the caller's doing becomes
// UNAVAILABLE: the server was stopping when the call came (gRPC reports it so), or a proxy lost its
// server. So does an answer that ended without a status, because a proxy lost its server in the
// middle of it: gRPC calls that UNKNOWN, "Stream removed".
inline absl::Status ToRetriable(const grpc::Status& status, const Cancellation* callers) {
  const bool has_no_status = status.error_code() == grpc::StatusCode::UNKNOWN &&
                             status.error_message() == "Stream removed";
  if ((status.error_code() != grpc::StatusCode::CANCELLED && !has_no_status) ||
      (callers != nullptr && callers->cancelled())) {
    return ToStatus(status);
  }
  return absl::UnavailableError("the call was broken off on its way or by the server");
}

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_CALL_STATUS_H_
