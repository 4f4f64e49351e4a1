#include "server/errors/error_details.h"

#include <algorithm>
#include <array>
#include <span>
#include <utility>

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "maneuver/v1/status.pb.h"
#include "model/files/file_system_failure.h"

namespace maneuver::errors {
namespace {

constexpr absl::string_view kErrorInfo = "type.googleapis.com/google.rpc.ErrorInfo";
constexpr absl::string_view kBadRequest = "type.googleapis.com/google.rpc.BadRequest";
constexpr absl::string_view kRetryInfo = "type.googleapis.com/google.rpc.RetryInfo";
constexpr std::array kInOrder = {kErrorInfo, kBadRequest, kRetryInfo};

// A server of files that starts again, or a mount that is mended, takes some seconds.
constexpr std::chrono::seconds kFolderRetryDelay{5};

constexpr int64_t kNanosecondsPerSecond = 1'000'000'000;

void Attach(absl::Status& status, absl::string_view type_url,
            const google::protobuf::MessageLite& detail) {
  status.SetPayload(type_url, absl::Cord(detail.SerializeAsString()));
}

std::string JoinPath(std::string_view prefix, const std::string& field) {
  if (prefix.empty()) return field;
  if (field.empty()) return std::string(prefix);
  return std::string(prefix) + "." + field;
}

}  // namespace

absl::Status InvalidFields(const std::vector<scene::FieldViolation>& violations,
                           std::string_view prefix) {
  v1::BadRequest detail;
  const std::span listed(violations.data(), std::min(violations.size(), kMaxListedViolations));
  auto found = static_cast<int64_t>(violations.size());
  for (const scene::FieldViolation& violation : violations) found += violation.others;
  for (const scene::FieldViolation& violation : listed) {
    auto* entry = detail.add_field_violations();
    entry->set_field(JoinPath(prefix, violation.field));
    entry->set_description(violation.description);
  }
  std::string message = "invalid request";
  if (!violations.empty()) {
    const auto& first = detail.field_violations(0);
    message = absl::StrCat(first.field(), ": ", first.description());
    if (found > 1) absl::StrAppend(&message, " (and ", found - 1, " more)");
    if (const int64_t others = found - detail.field_violations_size(); others > 0) {
      absl::StrAppend(detail.mutable_field_violations()->rbegin()->mutable_description(), " (and ",
                      others, " more fields are wrong)");
    }
  }
  absl::Status status = absl::InvalidArgumentError(message);
  Attach(status, kBadRequest, detail);
  return WithReason(std::move(status), "INVALID_FIELD");
}

absl::Status InvalidField(std::string_view field, std::string_view description) {
  return InvalidFields({{std::string(field), std::string(description)}});
}

absl::Status MalformedMessage() {
  return WithReason(
      absl::InvalidArgumentError("the request's bytes do not parse as the message of this method, "
                                 "or a string in it is not UTF-8"),
      "MALFORMED_MESSAGE");
}

absl::Status WithReason(absl::Status status, Reason reason,
                        const std::map<std::string, std::string>& metadata) {
  v1::ErrorInfo detail;
  detail.set_reason(std::string(reason.name()));
  detail.set_domain("maneuver");
  detail.mutable_metadata()->insert(metadata.begin(), metadata.end());
  Attach(status, kErrorInfo, detail);
  return status;
}

std::string ReasonOf(const absl::Status& status) {
  const auto payload = status.GetPayload(kErrorInfo);
  v1::ErrorInfo detail;
  if (!payload || !detail.ParseFromString(std::string(*payload))) return "";
  return detail.reason();
}

absl::Status WithFolderReason(absl::Status status, std::string_view folder) {
  if (!files::IsFileSystemFailure(status) || !ReasonOf(status).empty()) return status;
  const std::string name(folder);
  absl::Status away =
      absl::UnavailableError(absl::StrCat("the server cannot use its folder ", name, ": ",
                                          status.message(), "; try again once it is back"));
  return WithRetryDelay(WithReason(std::move(away), "FOLDER_UNAVAILABLE", {{"folder", name}}),
                        kFolderRetryDelay);
}

absl::Status WithStorageReason(absl::Status status) {
  if (status.ok() || !ReasonOf(status).empty()) return status;
  if (files::IsFileSystemFailure(status)) return WithFolderReason(std::move(status), "data");
  switch (status.code()) {
    case absl::StatusCode::kResourceExhausted:
      return WithReason(std::move(status), "DISK_FULL");
    case absl::StatusCode::kDataLoss:
      return WithReason(std::move(status), "STORAGE_DAMAGED");
    case absl::StatusCode::kPermissionDenied:
      return WithReason(absl::InternalError(status.message()), "STORAGE_INACCESSIBLE");
    default:
      return status;
  }
}

bool IsStoreAway(const absl::Status& status) { return ReasonOf(status) == "STORE_UNAVAILABLE"; }

absl::Status WithRetryDelay(absl::Status status, std::chrono::nanoseconds delay) {
  v1::RetryInfo detail;
  detail.mutable_retry_delay()->set_seconds(delay.count() / kNanosecondsPerSecond);
  detail.mutable_retry_delay()->set_nanos(
      static_cast<int32_t>(delay.count() % kNanosecondsPerSecond));
  Attach(status, kRetryInfo, detail);
  return status;
}

std::optional<std::chrono::nanoseconds> RetryDelay(const absl::Status& status) {
  const auto payload = status.GetPayload(kRetryInfo);
  v1::RetryInfo detail;
  if (!payload || !detail.ParseFromString(std::string(*payload))) return std::nullopt;
  return std::chrono::nanoseconds(detail.retry_delay().seconds() * kNanosecondsPerSecond +
                                  detail.retry_delay().nanos());
}

v1::Status ToProto(const absl::Status& status) {
  v1::Status proto;
  proto.set_code(static_cast<int32_t>(status.code()));
  proto.set_message(std::string(status.message()));
  for (const absl::string_view type_url : kInOrder) {
    if (const auto payload = status.GetPayload(type_url)) {
      auto* any = proto.add_details();
      any->set_type_url(std::string(type_url));
      any->set_value(std::string(*payload));
    }
  }
  return proto;
}

absl::Status FromProto(const v1::Status& proto) {
  const bool known = proto.code() >= 0 && proto.code() <= 16;
  absl::Status status(
      known ? static_cast<absl::StatusCode>(proto.code()) : absl::StatusCode::kUnknown,
      proto.message());
  for (const auto& any : proto.details()) {
    for (const absl::string_view type_url : kInOrder) {
      if (any.type_url() == type_url) status.SetPayload(type_url, absl::Cord(any.value()));
    }
  }
  return status;
}

}  // namespace maneuver::errors
