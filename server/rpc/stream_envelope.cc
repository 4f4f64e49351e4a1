#include "server/rpc/stream_envelope.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>
#include <grpcpp/support/proto_buffer_reader.h>

#include <cstdint>

#include "maneuver/v1/prediction_service.pb.h"

namespace maneuver::rpc {
namespace {

using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedInputStream;

constexpr uint32_t TagOf(int field) {
  return WireFormatLite::MakeTag(field, WireFormatLite::WIRETYPE_LENGTH_DELIMITED);
}

bool ReadBytes(CodedInputStream& input, std::string* bytes) {
  uint32_t length = 0;
  return input.ReadVarint32(&length) && input.ReadString(bytes, static_cast<int>(length));
}

}  // namespace

std::optional<StreamEnvelope> ReadEnvelope(const grpc::ByteBuffer& message) {
  grpc::ByteBuffer shared(message);  // the same bytes: a reader takes them from its buffer
  grpc::ProtoBufferReader reader(&shared);
  if (!reader.status().ok()) return std::nullopt;
  CodedInputStream input(&reader);
  StreamEnvelope envelope;
  std::string timeout;
  while (const uint32_t tag = input.ReadTag()) {
    bool good = false;
    if (tag == TagOf(v1::StreamPredictRequest::kRequestIdFieldNumber)) {
      good = ReadBytes(input, &envelope.request_id);
    } else if (tag == TagOf(v1::StreamPredictRequest::kTimeoutFieldNumber)) {
      // A message that comes in parts is merged.
      if (!envelope.timeout) envelope.timeout.emplace();
      good = ReadBytes(input, &timeout) && envelope.timeout->MergeFromString(timeout);
    } else {
      good = WireFormatLite::SkipField(&input, tag);
    }
    if (!good) return std::nullopt;
  }
  // A tag of zero that is not the end is none.
  if (!input.ConsumedEntireMessage()) return std::nullopt;
  return envelope;
}

}  // namespace maneuver::rpc
