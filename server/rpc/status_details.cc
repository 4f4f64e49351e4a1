#include "server/rpc/status_details.h"

#include <string>
#include <string_view>

#include "maneuver/v1/status.pb.h"

namespace maneuver::rpc {

namespace {

// Percent-encoding makes three of a byte, base 64 four of three.
constexpr size_t kMaxMessage = 900;
constexpr size_t kMaxField = 200;
constexpr size_t kMaxDetails = 3200;
constexpr char kBadRequest[] = "type.googleapis.com/google.rpc.BadRequest";

// Cuts `text` to at most `size` bytes, between two characters of UTF-8.
void Cut(size_t size, std::string* text) {
  constexpr std::string_view kDots = "...";
  if (text->size() <= size) return;
  size_t end = size - kDots.size();
  while (end > 0 && (static_cast<unsigned char>((*text)[end]) & 0xC0) == 0x80) --end;
  text->resize(end);
  *text += kDots;
}

void CutFields(v1::BadRequest* request) {
  for (auto& violation : *request->mutable_field_violations()) {
    Cut(kMaxField, violation.mutable_field());
    Cut(kMaxField, violation.mutable_description());
  }
}

// Returns a status whose headers clients take.
v1::Status Shortened(v1::Status status) {
  Cut(kMaxMessage, status.mutable_message());
  if (status.ByteSizeLong() <= kMaxDetails) return status;
  for (auto& any : *status.mutable_details()) {
    v1::BadRequest request;
    if (any.type_url() != kBadRequest || !request.ParseFromString(any.value())) continue;
    CutFields(&request);
    any.set_value(request.SerializeAsString());
    while (status.ByteSizeLong() > kMaxDetails && request.field_violations_size() > 1) {
      request.mutable_field_violations()->RemoveLast();
      any.set_value(request.SerializeAsString());
    }
  }
  return status;
}

}  // namespace

grpc::Status ToGrpcStatus(const absl::Status& status) {
  if (status.ok()) return grpc::Status::OK;
  const v1::Status proto = Shortened(errors::ToProto(status));
  // gRPC's third field becomes the trailer grpc-status-details-bin as it is. Without details the
  // trailer would say nothing that the code and the message do not.
  return grpc::Status(static_cast<grpc::StatusCode>(proto.code()), proto.message(),
                      proto.details().empty() ? std::string() : proto.SerializeAsString());
}

}  // namespace maneuver::rpc
