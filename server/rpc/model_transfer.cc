#include "server/rpc/model_transfer.h"

#include <utility>

#include "server/errors/error_details.h"
#include "server/security/resource_name.h"

namespace maneuver::rpc {
namespace {

// With the ErrorInfo that fits an error of an upload. One that has a reason keeps it.
absl::Status WithUploadReason(absl::Status status) {
  status = errors::WithFolderReason(std::move(status), "models");
  if (!errors::ReasonOf(status).empty()) return status;
  switch (status.code()) {
    case absl::StatusCode::kDataLoss:
    case absl::StatusCode::kInvalidArgument:
      return errors::WithReason(std::move(status), "MODEL_INVALID");
    case absl::StatusCode::kResourceExhausted:
      return errors::WithReason(std::move(status), "DISK_FULL");
    case absl::StatusCode::kAborted:
      return errors::WithReason(std::move(status), "UPLOAD_TAKEN_OVER");
    case absl::StatusCode::kUnavailable:
      return errors::WithReason(std::move(status), "UPLOAD_CHANGED");
    default:
      return errors::WithStorageReason(std::move(status));
  }
}

}  // namespace

ModelDownloadCall::ModelDownloadCall(const serving::VersionStore& store,
                                     const serving::ServingTable& table,
                                     const BlockingWork& blocking, security::AccessControl& access,
                                     grpc::CallbackServerContext* rpc,
                                     const v1::DownloadModelVersionRequest& request)
    : DownloadCall(blocking, rpc), store_(store), table_(table), request_(request) {
  Start(access, "/maneuver.v1.ModelService/DownloadModelVersion");
}

absl::StatusOr<std::unique_ptr<serving::VersionReader>> ModelDownloadCall::Open() {
  const auto reference = security::ParseModelReference(request_.name(), "name");
  if (!reference.ok()) return reference.status();
  const auto version = table_.Resolve(*reference);
  if (!version.ok()) return version.status();
  auto reader = serving::VersionReader::Open(*version, store_.FolderOf(*version));
  if (!reader.ok()) return reader.status();
  if (absl::Status status = (*reader)->Skip(request_.arrived_bytes()); !status.ok()) return status;
  return reader;
}

ModelUploadCall::ModelUploadCall(serving::VersionUploads& uploads, const BlockingWork& blocking,
                                 security::AccessControl& access, grpc::CallbackServerContext* rpc,
                                 grpc::ByteBuffer* response)
    : UploadCall(blocking, rpc, response),
      uploads_(uploads),
      caller_(access.NameOf(CredentialsOf(*rpc))) {
  Start(access, "/maneuver.v1.ModelService/UploadModelVersion");
}

absl::StatusOr<std::unique_ptr<serving::VersionUpload>> ModelUploadCall::Begin(
    const v1::UploadModelVersionRequest& first) {
  const v1::UploadModelHeader& header = first.header();
  const auto model = security::ParseModelName(header.parent(), "header.parent");
  if (!model.ok()) return model.status();
  const auto violations = serving::ValidateVersionFiles(header.files());
  if (!violations.empty()) return errors::InvalidFields(violations, "header");
  if (absl::Status status = CheckArrived(header.files(), header.arrived_bytes(), "file");
      !status.ok()) {
    return status;
  }
  return uploads_.Begin(*model, header, caller_);
}

absl::Status ModelUploadCall::WithReason(absl::Status status) const {
  return WithUploadReason(std::move(status));
}

absl::Status AnswerQueryModelUpload(serving::VersionUploads& uploads, const std::string& caller,
                                    const v1::QueryModelUploadRequest& request,
                                    v1::QueryModelUploadResponse* response) {
  const auto model = security::ParseModelName(request.parent(), "parent");
  if (!model.ok()) return model.status();
  const auto violations = serving::ValidateVersionFiles(request.files());
  if (!violations.empty()) return errors::InvalidFields(violations);
  auto found = uploads.Query(*model, request.files(), caller);
  if (!found.ok()) return found.status();
  *response = *std::move(found);
  return absl::OkStatus();
}

}  // namespace maneuver::rpc
