#include "server/rpc/request_outline.h"

#include <google/protobuf/io/coded_stream.h>
#include <grpcpp/support/proto_buffer_reader.h>

#include <algorithm>
#include <cstdint>

#include "maneuver/v1/prediction_service.pb.h"
#include "server/rpc/protobuf_internals.h"

namespace maneuver::rpc {
namespace {

using google::protobuf::io::CodedInputStream;

// The same field in each of them.
constexpr int kScenarios = v1::PredictRequest::kScenariosFieldNumber;
static_assert(kScenarios == v1::PredictActionProbabilitiesRequest::kScenariosFieldNumber);
static_assert(kScenarios == v1::PredictActionDistributionsRequest::kScenariosFieldNumber);
static_assert(kScenarios == v1::ClassifyTrajectoriesRequest::kScenariosFieldNumber);

bool ReadBytes(CodedInputStream& input, std::string* bytes) {
  uint32_t length = 0;
  return input.ReadVarint32(&length) && input.ReadString(bytes, static_cast<int>(length));
}

// Gives what is inside a field to `read`, and passes over what that leaves. False if the field is
// cut off.
template <typename Read>
bool ReadInside(CodedInputStream& input, const Read& read) {
  uint32_t length = 0;
  if (!input.ReadVarint32(&length) || length > INT32_MAX) return false;
  const auto limit = input.PushLimit(static_cast<int>(length));
  read(input);
  const bool whole = input.Skip(std::max(0, input.BytesUntilLimit()));
  input.PopLimit(limit);
  return whole;
}

// Ids in a row, or one: a serialiser may do either.
bool CountIds(CodedInputStream& input, uint32_t tag, size_t* ids) {
  uint64_t id = 0;
  if (tag == TagOf(v1::Scenario::kTargetIdsFieldNumber)) {
    return ReadInside(input, [&](CodedInputStream& row) {
      while (row.BytesUntilLimit() > 0 && row.ReadVarint64(&id)) ++*ids;
    });
  }
  if (!input.ReadVarint64(&id)) return false;
  ++*ids;
  return true;
}

void CountOfScenario(CodedInputStream& input, size_t* targets) {
  while (const uint32_t tag = input.ReadTag()) {
    // With any other type on the wire, the parser passes over the field too.
    constexpr int kIds = v1::Scenario::kTargetIdsFieldNumber;
    const bool ids = tag == TagOf(kIds) || tag == NumberTagOf(kIds);
    if (!(ids ? CountIds(input, tag, targets) : SkipField(input, tag))) return;
  }
}

void CountOfRequest(CodedInputStream& input, size_t* targets) {
  while (const uint32_t tag = input.ReadTag()) {
    const bool read = tag == TagOf(kScenarios)
                          ? ReadInside(input, [&](auto& in) { CountOfScenario(in, targets); })
                          : SkipField(input, tag);
    if (!read) return;
  }
}

}  // namespace

size_t CountTargets(const grpc::ByteBuffer& request) {
  grpc::ByteBuffer shared(request);  // the same bytes: a reader takes them from its buffer
  grpc::ProtoBufferReader reader(&shared);
  size_t targets = 0;
  if (reader.status().ok()) {
    CodedInputStream input(&reader);
    CountOfRequest(input, &targets);
  }
  return targets;
}

std::optional<StreamOutline> ReadStreamOutline(const grpc::ByteBuffer& message) {
  grpc::ByteBuffer shared(message);
  grpc::ProtoBufferReader reader(&shared);
  if (!reader.status().ok()) return std::nullopt;
  CodedInputStream input(&reader);
  StreamOutline outline;
  std::string timeout;
  while (const uint32_t tag = input.ReadTag()) {
    bool good = false;
    switch (tag) {
      case TagOf(v1::StreamPredictRequest::kRequestIdFieldNumber):
        good = ReadBytes(input, &outline.request_id) && IsUtf8(outline.request_id);
        break;
      case TagOf(v1::StreamPredictRequest::kTimeoutFieldNumber):
        // A message that comes in parts is merged.
        if (!outline.timeout) outline.timeout.emplace();
        good = ReadBytes(input, &timeout) && outline.timeout->MergeFromString(timeout);
        break;
      case TagOf(v1::StreamPredictRequest::kRequestFieldNumber):
        good = ReadInside(input, [&](auto& in) { CountOfRequest(in, &outline.targets); });
        break;
      default:
        good = SkipField(input, tag);
    }
    if (!good) return std::nullopt;
  }
  // A tag of zero that is not the end is none.
  if (!input.ConsumedEntireMessage()) return std::nullopt;
  return outline;
}

}  // namespace maneuver::rpc
