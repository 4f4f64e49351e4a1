#include "client/error_details.h"

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"

namespace maneuver::client {
namespace {

constexpr char kErrorInfo[] = "type.googleapis.com/google.rpc.ErrorInfo";
constexpr char kBadRequest[] = "type.googleapis.com/google.rpc.BadRequest";
constexpr char kRetryInfo[] = "type.googleapis.com/google.rpc.RetryInfo";

constexpr char kDomain[] = "maneuver";

// Adds what one detail says. Ignores other types and details that do not parse.
void Read(std::string_view type_url, const std::string& value, ErrorDetails* details) {
  if (type_url == kErrorInfo) {
    v1::ErrorInfo info;
    if (!info.ParseFromString(value)) return;
    details->reason = info.reason();
    details->metadata.insert(info.metadata().begin(), info.metadata().end());
    for (int i = 0; info.metadata().contains(absl::StrCat("action_name_", i)); ++i) {
      details->missing_action_names.push_back(details->metadata[absl::StrCat("action_name_", i)]);
    }
  } else if (type_url == kBadRequest) {
    v1::BadRequest bad;
    if (!bad.ParseFromString(value)) return;
    for (const auto& violation : bad.field_violations()) {
      details->field_violations.push_back({violation.field(), violation.description()});
    }
  } else if (type_url == kRetryInfo) {
    v1::RetryInfo retry;
    if (!retry.ParseFromString(value) || !retry.has_retry_delay()) return;
    details->retry_delay = absl::Seconds(retry.retry_delay().seconds()) +
                           absl::Nanoseconds(retry.retry_delay().nanos());
  }
}

void Add(const char* type_url, const google::protobuf::MessageLite& detail, absl::Status* status) {
  status->SetPayload(type_url, absl::Cord(detail.SerializeAsString()));
}

}  // namespace

absl::Status WithDetails(absl::Status status, const ErrorDetails& details) {
  if (!details.reason.empty()) {
    v1::ErrorInfo info;
    info.set_reason(details.reason);
    info.set_domain(kDomain);
    info.mutable_metadata()->insert(details.metadata.begin(), details.metadata.end());
    Add(kErrorInfo, info, &status);
  }
  if (!details.field_violations.empty()) {
    v1::BadRequest bad;
    for (const FieldViolation& violation : details.field_violations) {
      auto& added = *bad.add_field_violations();
      added.set_field(violation.field);
      added.set_description(violation.description);
    }
    Add(kBadRequest, bad, &status);
  }
  if (details.retry_delay) {
    v1::RetryInfo retry;
    absl::Duration rest;
    retry.mutable_retry_delay()->set_seconds(
        absl::IDivDuration(*details.retry_delay, absl::Seconds(1), &rest));
    retry.mutable_retry_delay()->set_nanos(static_cast<int32_t>(absl::ToInt64Nanoseconds(rest)));
    Add(kRetryInfo, retry, &status);
  }
  return status;
}

ErrorDetails ErrorDetailsOf(const absl::Status& status) {
  ErrorDetails details;
  status.ForEachPayload([&](absl::string_view type_url, const absl::Cord& value) {
    Read(std::string_view(type_url.data(), type_url.size()), std::string(value), &details);
  });
  return details;
}

ErrorDetails ErrorDetailsOf(const v1::Status& status) {
  ErrorDetails details;
  for (const auto& any : status.details()) Read(any.type_url(), any.value(), &details);
  return details;
}

absl::Status ToStatus(const v1::Status& status) {
  absl::Status result(static_cast<absl::StatusCode>(status.code()), status.message());
  if (result.ok()) return result;
  for (const auto& any : status.details()) {
    result.SetPayload(any.type_url(), absl::Cord(any.value()));
  }
  return result;
}

absl::Status StatusFromWire(int code, std::string_view message, std::string_view details_bin) {
  v1::Status status;
  if (!status.ParseFromArray(details_bin.data(), static_cast<int>(details_bin.size()))) {
    status.Clear();
  }
  // The call's own code and message take precedence.
  status.set_code(code);
  status.set_message(std::string(message));
  return ToStatus(status);
}

}  // namespace maneuver::client
