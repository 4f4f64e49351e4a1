#ifndef MANEUVER_SERVER_RPC_DATASET_UPLOAD_H_
#define MANEUVER_SERVER_RPC_DATASET_UPLOAD_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <memory>

#include "absl/status/status.h"
#include "maneuver/v1/dataset_service.pb.h"
#include "model/data/dataset_store.h"
#include "server/jobs/worker_pool.h"

namespace maneuver::rpc {

// One UploadDataset call. The next message is read once the last is on its way to the disk: a fast
// client waits for a slow disk. Deletes itself.
class DatasetUploadCall final : public grpc::ServerReadReactor<v1::UploadDatasetRequest> {
 public:
  DatasetUploadCall(data::DatasetStore& datasets, jobs::WorkerPool& pool,
                    grpc::CallbackServerContext* rpc, v1::Dataset* response);

  void OnReadDone(bool ok) override;
  void OnDone() override { delete this; }

 private:
  // One of them at a time, on a thread of the pool.
  void TakeStep(bool has_message);
  absl::Status TakeMessage();
  absl::Status TakeHeader(const v1::UploadHeader& header);
  absl::Status Commit();

  data::DatasetStore& datasets_;
  jobs::WorkerPool& pool_;
  grpc::CallbackServerContext* const rpc_;
  v1::Dataset* const response_;
  v1::UploadDatasetRequest message_;
  std::unique_ptr<data::DatasetUpload> upload_;  // once the header came
};

// With the ErrorInfo that fits an error of the dataset store.
absl::Status WithDatasetReason(absl::Status status);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_DATASET_UPLOAD_H_
