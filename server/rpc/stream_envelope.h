// What a StreamPredictRequest is about, without its request.

#ifndef MANEUVER_SERVER_RPC_STREAM_ENVELOPE_H_
#define MANEUVER_SERVER_RPC_STREAM_ENVELOPE_H_

#include <google/protobuf/duration.pb.h>
#include <grpcpp/support/byte_buffer.h>

#include <optional>
#include <string>

namespace maneuver::rpc {

struct StreamEnvelope {
  std::string request_id;
  std::optional<google::protobuf::Duration> timeout;
};

// Reads the bytes of a StreamPredictRequest, and passes over those of the scenes, which are nearly
// all of them: whether a request is worth its work is known before it was parsed. Nothing if they
// are no such message; if they are one but for the scenes, that is left to whoever parses them.
std::optional<StreamEnvelope> ReadEnvelope(const grpc::ByteBuffer& message);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_STREAM_ENVELOPE_H_
