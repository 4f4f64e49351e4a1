#include "server/rpc/dataset_upload.h"

#include <utility>
#include <vector>

#include "model/data/dataset_folder.h"
#include "server/errors/error_details.h"
#include "server/security/resource_name.h"

namespace maneuver::rpc {

DatasetUploadCall::DatasetUploadCall(data::DatasetStore& datasets, const BlockingWork& blocking,
                                     security::AccessControl& access,
                                     grpc::CallbackServerContext* rpc, grpc::ByteBuffer* response)
    : UploadCall(blocking, rpc, response),
      datasets_(datasets),
      caller_(access.NameOf(CredentialsOf(*rpc))) {
  Start(access, "/maneuver.v1.DatasetService/UploadDataset");
}

absl::StatusOr<std::unique_ptr<data::DatasetUpload>> DatasetUploadCall::Begin(
    const v1::UploadDatasetRequest& first) {
  const v1::UploadHeader& header = first.header();
  const auto id = security::ParseDatasetName(header.name(), "header.name");
  if (!id.ok()) return id.status();
  const auto violations = data::ValidateDatasetManifest(header.dataset());
  if (!violations.empty()) return errors::InvalidFields(violations, "header.dataset");
  if (absl::Status status =
          CheckArrived(header.dataset().shards(), header.arrived_bytes(), "shard");
      !status.ok()) {
    return status;
  }
  return datasets_.BeginUpload(
      *id, header.dataset(), caller_,
      std::vector<int64_t>(header.arrived_bytes().begin(), header.arrived_bytes().end()));
}

absl::Status DatasetUploadCall::WithReason(absl::Status status) const {
  return WithDatasetReason(std::move(status));
}

absl::Status AnswerQueryUpload(const data::DatasetStore& datasets, const std::string& caller,
                               const v1::QueryUploadRequest& request,
                               v1::QueryUploadResponse* response) {
  const auto id = security::ParseDatasetName(request.name(), "name");
  if (!id.ok()) return id.status();
  const auto violations = data::ValidateDatasetManifest(request.dataset());
  if (!violations.empty()) return errors::InvalidFields(violations, "dataset");
  auto found = datasets.QueryUpload(*id, request.dataset(), caller);
  if (!found.ok()) return WithDatasetReason(found.status());
  *response = *std::move(found);
  return absl::OkStatus();
}

absl::Status WithDatasetReason(absl::Status status) {
  status = errors::WithFolderReason(std::move(status), "datasets");
  if (!errors::ReasonOf(status).empty()) return status;
  switch (status.code()) {
    case absl::StatusCode::kNotFound:
      return errors::WithReason(std::move(status), "DATASET_NOT_FOUND");
    case absl::StatusCode::kAlreadyExists:
      return errors::WithReason(std::move(status), "DATASET_EXISTS");
    case absl::StatusCode::kDataLoss:
      return errors::WithReason(std::move(status), "DATASET_DAMAGED");
    case absl::StatusCode::kInvalidArgument:
      return errors::WithReason(std::move(status), "DATASET_INVALID");
    case absl::StatusCode::kResourceExhausted:
      return errors::WithReason(std::move(status), "DISK_FULL");
    case absl::StatusCode::kFailedPrecondition:
      return errors::WithReason(absl::ResourceExhaustedError(status.message()), "DATASET_QUOTA");
    case absl::StatusCode::kAborted:
      return errors::WithReason(std::move(status), "UPLOAD_TAKEN_OVER");
    case absl::StatusCode::kUnavailable:
      return errors::WithReason(std::move(status), "UPLOAD_CHANGED");
    default:
      return errors::WithStorageReason(std::move(status));
  }
}

}  // namespace maneuver::rpc
