#ifndef MANEUVER_SERVER_RPC_MODEL_TRANSFER_H_
#define MANEUVER_SERVER_RPC_MODEL_TRANSFER_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "maneuver/v1/model_service.pb.h"
#include "server/rpc/download_call.h"
#include "server/rpc/upload_call.h"
#include "server/serving/serving_table.h"
#include "server/serving/version_files.h"
#include "server/serving/version_store.h"
#include "server/serving/version_uploads.h"

namespace maneuver::rpc {

// One DownloadModelVersion call.
class ModelDownloadCall final
    : public DownloadCall<v1::DownloadModelVersionResponse, serving::VersionReader> {
 public:
  ModelDownloadCall(const serving::VersionStore& store, const serving::ServingTable& table,
                    const BlockingWork& blocking, security::AccessControl& access,
                    grpc::CallbackServerContext* rpc,
                    const v1::DownloadModelVersionRequest& request);

 private:
  absl::StatusOr<std::unique_ptr<serving::VersionReader>> Open() override;
  absl::Status WithReason(absl::Status status) const override { return status; }

  const serving::VersionStore& store_;
  const serving::ServingTable& table_;
  const v1::DownloadModelVersionRequest request_;
};

// One UploadModelVersion call.
class ModelUploadCall final
    : public UploadCall<v1::UploadModelVersionRequest, v1::ModelVersion, serving::VersionUpload> {
 public:
  ModelUploadCall(serving::VersionUploads& uploads, const BlockingWork& blocking,
                  security::AccessControl& access, grpc::CallbackServerContext* rpc,
                  grpc::ByteBuffer* response);

 private:
  absl::StatusOr<std::unique_ptr<serving::VersionUpload>> Begin(
      const v1::UploadModelVersionRequest& first) override;
  absl::Status WithReason(absl::Status status) const override;

  serving::VersionUploads& uploads_;
  const std::string caller_;
};

// Answers which bytes of the request's version have arrived from `caller`. INVALID_ARGUMENT for a
// wrong name or wrong files; errors of VersionUploads::Query.
absl::Status AnswerQueryModelUpload(serving::VersionUploads& uploads, const std::string& caller,
                                    const v1::QueryModelUploadRequest& request,
                                    v1::QueryModelUploadResponse* response);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_MODEL_TRANSFER_H_
