// Converts absl::Status, with the details that server/errors attached, to gRPC's form.

#ifndef MANEUVER_SERVER_RPC_STATUS_DETAILS_H_
#define MANEUVER_SERVER_RPC_STATUS_DETAILS_H_

#include <grpcpp/support/status.h>

#include "absl/status/status.h"
#include "server/errors/error_details.h"

namespace maneuver::rpc {

// Returns the code, the message, and a google.rpc.Status as grpc-status-details-bin. OK stays OK.
//
// Clients accept 8 KiB of headers and report any larger error with another code. So long messages
// and fields are cut, and violations that do not fit are left out.
grpc::Status ToGrpcStatus(const absl::Status& status);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_STATUS_DETAILS_H_
