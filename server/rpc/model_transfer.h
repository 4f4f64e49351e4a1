#ifndef MANEUVER_SERVER_RPC_MODEL_TRANSFER_H_
#define MANEUVER_SERVER_RPC_MODEL_TRANSFER_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <memory>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "locks/mutex.h"
#include "maneuver/v1/model_service.pb.h"
#include "server/rpc/upload_call.h"
#include "server/serving/serving_table.h"
#include "server/serving/version_files.h"
#include "server/serving/version_store.h"
#include "server/serving/version_uploads.h"

namespace maneuver::rpc {

// One DownloadModelVersion call. It reads the disk only after the client has taken the previous
// chunk, so a slow client costs one chunk and delays nobody. Deletes itself.
class ModelDownloadCall final : public grpc::ServerWriteReactor<v1::DownloadModelVersionResponse> {
 public:
  ModelDownloadCall(const serving::VersionStore& store, const serving::ServingTable& table,
                    WorkerPool& pool, security::AccessControl& access,
                    grpc::CallbackServerContext* rpc,
                    const v1::DownloadModelVersionRequest& request);

  void OnWriteDone(bool ok) override;
  void OnDone() override { delete this; }

 private:
  // Called each time the token is found revoked. The first call ends the download before its next
  // chunk. The second call cancels the RPC of a client that does not read.
  void OnRefused(const absl::Status& refusal);
  // Runs one step on a thread of the pool; never two at a time.
  void TakeStep();
  // Fills message_. Returns false at the end.
  absl::StatusOr<bool> ReadNext();
  absl::Status Open();
  void End(const absl::Status& status);

  const serving::VersionStore& store_;
  const serving::ServingTable& table_;
  WorkerPool& pool_;
  grpc::CallbackServerContext* const rpc_;
  const v1::DownloadModelVersionRequest request_;

  // Used only by the step in progress.
  std::unique_ptr<serving::VersionReader> reader_;
  v1::DownloadModelVersionResponse message_;

  Mutex mutex_;
  absl::Status refusal_ ABSL_GUARDED_BY(mutex_);
  bool has_ended_ ABSL_GUARDED_BY(mutex_) = false;

  // Last, so that it is destroyed first and calls no destroyed object.
  std::unique_ptr<security::AccessControl::LongCall> admission_;
};

// One UploadModelVersion call.
class ModelUploadCall final
    : public UploadCall<v1::UploadModelVersionRequest, v1::ModelVersion, serving::VersionUpload> {
 public:
  ModelUploadCall(serving::VersionUploads& uploads, WorkerPool& pool,
                  security::AccessControl& access, grpc::CallbackServerContext* rpc,
                  v1::ModelVersion* response);

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
