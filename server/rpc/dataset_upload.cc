#include "server/rpc/dataset_upload.h"

#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "server/errors/error_details.h"
#include "server/rpc/blocking_call.h"
#include "server/rpc/guarded_service.h"
#include "server/security/resource_name.h"

namespace maneuver::rpc {
namespace {

constexpr size_t kMaxChunk = size_t{1} << 20;
constexpr char kUploadMethod[] = "/maneuver.v1.DatasetService/UploadDataset";

// Of a valid manifest: nothing, or a number for each shard that fits its size.
absl::Status CheckArrived(const v1::UploadHeader& header) {
  const int numbers = header.arrived_bytes_size();
  if (numbers == 0) return absl::OkStatus();
  if (numbers != header.dataset().shards_size()) {
    return errors::InvalidField("header.arrived_bytes",
                                absl::StrCat("must be empty or have a number for each of the ",
                                             header.dataset().shards_size(), " shards"));
  }
  for (int i = 0; i < numbers; ++i) {
    const int64_t size = header.dataset().shards(i).size_bytes();
    if (header.arrived_bytes(i) >= 0 && header.arrived_bytes(i) <= size) continue;
    return errors::InvalidField(absl::StrCat("header.arrived_bytes[", i, "]"),
                                absl::StrCat("must be from 0 to the shard's size, ", size));
  }
  return absl::OkStatus();
}

}  // namespace

DatasetUploadCall::DatasetUploadCall(data::DatasetStore& datasets, jobs::WorkerPool& pool,
                                     security::AccessControl& access,
                                     grpc::CallbackServerContext* rpc, v1::Dataset* response)
    : datasets_(datasets),
      pool_(pool),
      caller_(access.NameOf(CredentialsOf(*rpc))),
      rpc_(rpc),
      response_(response) {
  admission_ = access.Watch(kUploadMethod, CredentialsOf(*rpc),
                            [this](const absl::Status& refusal) { OnRefused(refusal); });
  ReadOn();
}

void DatasetUploadCall::OnRefused(const absl::Status& refusal) {
  {
    const std::lock_guard lock(mutex_);
    refusal_ = refusal;
    if (!reading_.exchange(false)) return;  // who works on the call will see it
  }
  // The read that is left pending ends with the call.
  pool_.Continue([this, refusal] { EndRefused(refusal); });
}

void DatasetUploadCall::OnReadDone(bool ok) {
  if (!reading_.exchange(false)) return;  // the call was refused
  const auto step = [this, ok] { TakeStep(ok); };
  if (upload_ != nullptr) {
    pool_.Continue(step);
  } else if (!pool_.Post(step)) {
    End(Busy());
  }
}

void DatasetUploadCall::TakeStep(bool has_message) {
  const absl::Status status = has_message ? TakeMessage() : Commit();
  if (status.ok() && has_message) {
    ReadOn();
  } else {
    End(status);
  }
}

void DatasetUploadCall::ReadOn() {
  absl::Status refusal;
  {
    // No refusal comes between; OnReadDone, which may come at once, takes no lock.
    const std::lock_guard lock(mutex_);
    refusal = refusal_;
    if (refusal.ok()) {
      reading_ = true;
      StartRead(&message_);
    }
  }
  if (!refusal.ok()) EndRefused(refusal);
}

void DatasetUploadCall::EndRefused(const absl::Status& refusal) {
  // Whoever may not upload may leave nothing here either.
  if (upload_ != nullptr) upload_->Discard();
  End(refusal);
}

void DatasetUploadCall::End(const absl::Status& status) {
  // Before the client hears of it, and asks what has arrived.
  upload_.reset();
  {
    const std::lock_guard lock(mutex_);  // ReadOn, on another thread, has let go of it
  }
  Finish(ToGrpcStatus(status));
}

absl::Status DatasetUploadCall::TakeMessage() {
  if (upload_ == nullptr) {
    if (message_.has_header()) return TakeHeader(message_.header());
    return errors::InvalidField("header", "must be the first message of an upload");
  }
  if (message_.has_header()) {
    return errors::InvalidField("header", "must be the first message alone");
  }
  if (message_.chunk().size() > kMaxChunk) {
    return errors::InvalidField("chunk", "must have at most 1 MiB");
  }
  return WithDatasetReason(upload_->Append(message_.chunk()));
}

absl::Status DatasetUploadCall::TakeHeader(const v1::UploadHeader& header) {
  const auto id = security::ParseDatasetName(header.name(), "header.name");
  if (!id.ok()) return id.status();
  const auto violations = data::ValidateDatasetManifest(header.dataset());
  if (!violations.empty()) return errors::InvalidFields(violations, "header.dataset");
  if (absl::Status status = CheckArrived(header); !status.ok()) return status;
  auto upload = datasets_.BeginUpload(
      *id, header.dataset(), caller_,
      std::vector<int64_t>(header.arrived_bytes().begin(), header.arrived_bytes().end()));
  if (!upload.ok()) return WithDatasetReason(upload.status());
  upload_ = *std::move(upload);
  return absl::OkStatus();
}

absl::Status DatasetUploadCall::Commit() {
  // A broken stream ends like one that the client closed.
  if (rpc_->IsCancelled()) return absl::CancelledError("the upload was broken off");
  if (upload_ == nullptr) {
    return errors::InvalidField("header", "must be the first message of an upload");
  }
  auto dataset = upload_->Commit();
  if (!dataset.ok()) return WithDatasetReason(dataset.status());
  *response_ = *std::move(dataset);
  return absl::OkStatus();
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
