#ifndef MANEUVER_SERVER_RPC_DATASET_UPLOAD_H_
#define MANEUVER_SERVER_RPC_DATASET_UPLOAD_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <memory>
#include <mutex>
#include <string>

#include "absl/status/status.h"
#include "maneuver/v1/dataset_service.pb.h"
#include "model/data/dataset_store.h"
#include "server/jobs/worker_pool.h"
#include "server/security/access_control.h"

namespace maneuver::rpc {

// One UploadDataset call. The next message is read once the last is on its way to the disk: a fast
// client waits for a slow disk. Deletes itself.
class DatasetUploadCall final : public grpc::ServerReadReactor<v1::UploadDatasetRequest> {
 public:
  DatasetUploadCall(data::DatasetStore& datasets, jobs::WorkerPool& pool,
                    security::AccessControl& access, grpc::CallbackServerContext* rpc,
                    v1::Dataset* response);

  void OnReadDone(bool ok) override;
  void OnDone() override { delete this; }

 private:
  // The caller's token was taken back: the call ends as soon as nobody works on it.
  void OnRefused(const absl::Status& refusal);
  void ReadOn();
  void End(const absl::Status& status);
  void EndRefused(const absl::Status& refusal);
  // One of them at a time, on a thread of the pool.
  void TakeStep(bool has_message);
  absl::Status TakeMessage();
  absl::Status TakeHeader(const v1::UploadHeader& header);
  absl::Status Commit();

  data::DatasetStore& datasets_;
  jobs::WorkerPool& pool_;
  const std::string caller_;
  grpc::CallbackServerContext* const rpc_;
  v1::Dataset* const response_;
  v1::UploadDatasetRequest message_;
  std::unique_ptr<data::DatasetUpload> upload_;  // once the header came; of who works on the call

  // A read is under way. Who turns it to false goes on with the call: OnReadDone, or a refusal.
  std::atomic<bool> reading_ = false;
  std::mutex mutex_;
  absl::Status refusal_;  // guarded by mutex_

  // Last, so that it ends first: nobody refuses what is gone.
  std::unique_ptr<security::AccessControl::LongCall> admission_;
};

// What of the request's dataset has arrived from `caller`.
absl::Status AnswerQueryUpload(const data::DatasetStore& datasets, const std::string& caller,
                               const v1::QueryUploadRequest& request,
                               v1::QueryUploadResponse* response);

// With the ErrorInfo that fits an error of the dataset store.
absl::Status WithDatasetReason(absl::Status status);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_DATASET_UPLOAD_H_
