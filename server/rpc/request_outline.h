// What a prediction request asks for, read from its bytes: whether it is worth its work is known
// before it was parsed, which is a good part of that work.

#ifndef MANEUVER_SERVER_RPC_REQUEST_OUTLINE_H_
#define MANEUVER_SERVER_RPC_REQUEST_OUTLINE_H_

#include <google/protobuf/duration.pb.h>
#include <grpcpp/support/byte_buffer.h>

#include <cstddef>
#include <optional>
#include <string>

namespace maneuver::rpc {

// Targets of all scenarios of a PredictRequest, PredictActionProbabilitiesRequest,
// PredictActionDistributionsRequest or ClassifyTrajectoriesRequest. All else is passed over: of
// bytes that are no such message, what was seen of one.
size_t CountTargets(const grpc::ByteBuffer& request);

struct StreamOutline {
  std::string request_id;
  std::optional<google::protobuf::Duration> timeout;
  size_t targets = 0;
};

// Of a StreamPredictRequest. Nothing if the bytes are no such message; if they are one but for what
// is inside `request`, that is left to whoever parses it.
std::optional<StreamOutline> ReadStreamOutline(const grpc::ByteBuffer& message);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_REQUEST_OUTLINE_H_
