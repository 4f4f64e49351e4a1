// Reads from the bytes of a request what it asks for and how large it is in memory. The server can
// then refuse it before parsing, which is a good part of the work.

#ifndef MANEUVER_SERVER_RPC_REQUEST_OUTLINE_H_
#define MANEUVER_SERVER_RPC_REQUEST_OUTLINE_H_

#include <google/protobuf/descriptor.h>
#include <google/protobuf/duration.pb.h>
#include <grpcpp/support/byte_buffer.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/status.h"

namespace maneuver::rpc {

// Returns the number of targets in all scenarios of a PredictRequest,
// PredictActionProbabilitiesRequest, PredictActionDistributionsRequest or
// ClassifyTrajectoriesRequest. Skips everything else. In malformed bytes it counts what it can
// read.
size_t CountTargets(const grpc::ByteBuffer& request);

struct StreamOutline {
  std::string request_id;
  std::optional<google::protobuf::Duration> timeout;
  size_t targets = 0;
};

// Reads the outline of a StreamPredictRequest. Returns nothing if the bytes are not such a message.
// Errors inside `request` are left to the parser.
std::optional<StreamOutline> ReadStreamOutline(const grpc::ByteBuffer& message);

// Returns report.request_id of a StreamOutcomesRequest, or "" if it is longer than `most` bytes, not
// UTF-8, or behind bytes that are not such a message. Does not read the outcomes.
std::string ReadReportId(const grpc::ByteBuffer& message, size_t most);

// Smaller messages cannot take much memory.
inline constexpr int64_t kLeastCheckedDensity = int64_t{1} << 20;

// Returns INVALID_ARGUMENT for a message of this type, of kLeastCheckedDensity or more, that takes more than 16
// times its bytes in memory once it is parsed. Only one that is full of empty elements does: each
// takes 2 bytes here, and up to some hundred there. Leaves malformed bytes to the parser.
absl::Status CheckDensity(const google::protobuf::Descriptor& type,
                          const grpc::ByteBuffer& message);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_REQUEST_OUTLINE_H_
