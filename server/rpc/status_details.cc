#include "server/rpc/status_details.h"

#include "maneuver/v1/status.pb.h"

namespace maneuver::rpc {

grpc::Status ToGrpcStatus(const absl::Status& status) {
  if (status.ok()) return grpc::Status::OK;
  const v1::Status proto = errors::ToProto(status);
  // gRPC's third field becomes the trailer grpc-status-details-bin as it is. Without details the
  // trailer would say nothing that the code and the message do not.
  return grpc::Status(static_cast<grpc::StatusCode>(proto.code()), proto.message(),
                      proto.details().empty() ? std::string() : proto.SerializeAsString());
}

}  // namespace maneuver::rpc
