#ifndef MANEUVER_SERVER_RPC_DATASET_UPLOAD_H_
#define MANEUVER_SERVER_RPC_DATASET_UPLOAD_H_

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "maneuver/v1/dataset_service.pb.h"
#include "model/data/dataset_store.h"
#include "server/rpc/upload_call.h"

namespace maneuver::rpc {

// One UploadDataset call.
class DatasetUploadCall final
    : public UploadCall<v1::UploadDatasetRequest, v1::Dataset, data::DatasetUpload> {
 public:
  DatasetUploadCall(data::DatasetStore& datasets, const BlockingWork& blocking,
                    security::AccessControl& access, grpc::CallbackServerContext* rpc,
                    grpc::ByteBuffer* response);

 private:
  absl::StatusOr<std::unique_ptr<data::DatasetUpload>> Begin(
      const v1::UploadDatasetRequest& first) override;
  absl::Status WithReason(absl::Status status) const override;

  data::DatasetStore& datasets_;
  const std::string caller_;
};

// Answers which bytes of the request's dataset have arrived from `caller`. INVALID_ARGUMENT for a
// wrong name or manifest; errors of DatasetStore::QueryUpload, by WithDatasetReason.
absl::Status AnswerQueryUpload(const data::DatasetStore& datasets, const std::string& caller,
                               const v1::QueryUploadRequest& request,
                               v1::QueryUploadResponse* response);

// Adds the ErrorInfo that fits an error of the dataset store, unless it has one already. A full
// quota, FAILED_PRECONDITION, becomes RESOURCE_EXHAUSTED.
absl::Status WithDatasetReason(absl::Status status);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_DATASET_UPLOAD_H_
