#include "server/rpc/request_outline.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/message.h>
#include <grpcpp/support/proto_buffer_reader.h>

#include <algorithm>
#include <cstdint>
#include <unordered_map>

#include "absl/strings/str_cat.h"
#include "maneuver/v1/outcome_service.pb.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "server/errors/error_details.h"
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

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;

// Adds up what a message takes in memory once it is parsed, about.
class ParsedSize {
 public:
  explicit ParsedSize(int64_t most) : most_(most) {}

  void Add(const Descriptor& type, CodedInputStream& input, int depth = 0) {
    bytes_ += SizeOf(type);
    while (bytes_ <= most_) {
      const uint32_t tag = input.ReadTag();
      if (tag == 0) return;
      // proto3 has no groups. The parser would keep one with all that is in it.
      if ((tag & kTypeMask) == kStartGroup) bytes_ = most_ + 1;
      const FieldDescriptor* const field =
          type.FindFieldByNumber(static_cast<int>(tag >> kTypeBits));
      const bool is_message = field != nullptr && field->message_type() != nullptr;
      // What is not in the contract is kept as it came, in an element of its own.
      bytes_ += field == nullptr ? kElement : kNumber;
      if (tag != TagOf(static_cast<int>(tag >> kTypeBits)) || (is_message && depth == kDeepest)) {
        if (!SkipField(input, tag)) return;
        continue;
      }
      const bool read = ReadInside(input, [&](CodedInputStream& inside) {
        if (is_message) return Add(*field->message_type(), inside, depth + 1);
        // Numbers of one byte each may become numbers of eight.
        const int64_t length = inside.BytesUntilLimit();
        const bool is_row = field != nullptr && field->is_packable();
        bytes_ += is_row ? kNumber * length : kElement + length;
      });
      if (!read) return;
    }
  }

  int64_t bytes() const { return bytes_; }

 private:
  static constexpr int kTypeBits = 3;
  static constexpr uint32_t kTypeMask = 7;
  static constexpr uint32_t kStartGroup = 3;
  static constexpr int kDeepest = 90;  // the parser stops at 100
  static constexpr int64_t kNumber = 8;
  static constexpr int64_t kElement = 40;  // a text

  int64_t SizeOf(const Descriptor& type) {
    const auto [size, is_new] = sizes_.try_emplace(&type, 0);
    if (is_new) {
      const auto* prototype =
          google::protobuf::MessageFactory::generated_factory()->GetPrototype(&type);
      size->second =
          prototype == nullptr ? kElement : static_cast<int64_t>(prototype->SpaceUsedLong());
    }
    return size->second;
  }

  const int64_t most_;
  int64_t bytes_ = 0;
  std::unordered_map<const Descriptor*, int64_t> sizes_;
};

}  // namespace

absl::Status CheckDensity(const Descriptor& type, const grpc::ByteBuffer& message) {
  constexpr int64_t kMostTimes = 16;
  const auto size = static_cast<int64_t>(message.Length());
  if (size < kLeastCheckedDensity) return absl::OkStatus();
  grpc::ByteBuffer shared(message);
  grpc::ProtoBufferReader reader(&shared);
  if (!reader.status().ok()) return absl::OkStatus();
  CodedInputStream input(&reader);
  ParsedSize parsed(kMostTimes * size);
  parsed.Add(type, input);
  if (parsed.bytes() <= kMostTimes * size) return absl::OkStatus();
  return errors::InvalidField("request",
                              absl::StrCat("its ", size, " bytes would take more than ", kMostTimes,
                                           " times as many in memory; leave out empty elements"));
}

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

std::string ReadReportId(const grpc::ByteBuffer& message, size_t most) {
  grpc::ByteBuffer shared(message);
  grpc::ProtoBufferReader reader(&shared);
  std::string id;
  if (!reader.status().ok()) return id;
  const auto read_report = [&id, most](CodedInputStream& input) {
    while (const uint32_t tag = input.ReadTag()) {
      if (tag != TagOf(v1::ReportOutcomesRequest::kRequestIdFieldNumber)) {
        if (!SkipField(input, tag)) return;
        continue;
      }
      id.clear();  // of several the last one counts
      uint32_t length = 0;
      if (!input.ReadVarint32(&length) || length > most) return;
      if (!input.ReadString(&id, static_cast<int>(length))) return id.clear();
    }
  };
  CodedInputStream input(&reader);
  while (const uint32_t tag = input.ReadTag()) {
    const bool read = tag == TagOf(v1::StreamOutcomesRequest::kReportFieldNumber)
                          ? ReadInside(input, read_report)
                          : SkipField(input, tag);
    if (!read) break;
  }
  if (!IsUtf8(id)) id.clear();
  return id;
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
