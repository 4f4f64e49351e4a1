#ifndef MANEUVER_SERVER_RPC_DATASET_SERVICE_H_
#define MANEUVER_SERVER_RPC_DATASET_SERVICE_H_

#include "maneuver/v1/dataset_service.grpc.pb.h"
#include "model/data/dataset_store.h"
#include "server/jobs/supervisor.h"
#include "server/rpc/blocking_call.h"
#include "server/security/access_control.h"

namespace maneuver::rpc {

// Uploads, registers, describes, reads and deletes datasets.
class DatasetService final : public v1::DatasetService::WithRawCallbackMethod_UploadDataset<
                                 v1::DatasetService::CallbackService> {
 public:
  // All arguments must outlive the service. The .cc defines the constructor and the destructor, for
  // the reason that admin_service.h gives.
  DatasetService(data::DatasetStore& datasets, jobs::Supervisor& jobs, const BlockingWork& blocking,
                 security::AccessControl& access);
  ~DatasetService() override;

  grpc::ServerReadReactor<grpc::ByteBuffer>* UploadDataset(grpc::CallbackServerContext* rpc,
                                                           grpc::ByteBuffer* response) override;
  grpc::ServerUnaryReactor* QueryUpload(grpc::CallbackServerContext* rpc,
                                        const v1::QueryUploadRequest* request,
                                        v1::QueryUploadResponse* response) override;
  grpc::ServerUnaryReactor* RegisterDataset(grpc::CallbackServerContext* rpc,
                                            const v1::RegisterDatasetRequest* request,
                                            v1::Dataset* response) override;
  grpc::ServerUnaryReactor* ListDatasets(grpc::CallbackServerContext* rpc,
                                         const v1::ListDatasetsRequest* request,
                                         v1::ListDatasetsResponse* response) override;
  grpc::ServerUnaryReactor* GetDataset(grpc::CallbackServerContext* rpc,
                                       const v1::GetDatasetRequest* request,
                                       v1::Dataset* response) override;
  grpc::ServerUnaryReactor* DescribeDataset(grpc::CallbackServerContext* rpc,
                                            const v1::DescribeDatasetRequest* request,
                                            v1::DatasetSummary* response) override;
  grpc::ServerUnaryReactor* DeleteDataset(grpc::CallbackServerContext* rpc,
                                          const v1::DeleteDatasetRequest* request,
                                          google::protobuf::Empty* response) override;
  grpc::ServerUnaryReactor* ListScenarios(grpc::CallbackServerContext* rpc,
                                          const v1::ListScenariosRequest* request,
                                          v1::ListScenariosResponse* response) override;
  grpc::ServerUnaryReactor* GetScenario(grpc::CallbackServerContext* rpc,
                                        const v1::GetScenarioRequest* request,
                                        v1::Scenario* response) override;

 private:
  data::DatasetStore& datasets_;
  jobs::Supervisor& jobs_;
  const BlockingWork blocking_;
  security::AccessControl& access_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_DATASET_SERVICE_H_
