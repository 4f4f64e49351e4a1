#ifndef MANEUVER_SERVER_RPC_MODEL_SERVICE_H_
#define MANEUVER_SERVER_RPC_MODEL_SERVICE_H_

#include "maneuver/v1/model_service.grpc.pb.h"
#include "server/rpc/blocking_call.h"
#include "server/security/access_control.h"
#include "server/serving/serving_table.h"
#include "server/serving/version_store.h"
#include "server/serving/version_uploads.h"

namespace maneuver::rpc {

// Lists, copies and deletes versions, moves aliases, labels actions and returns evaluations.
class ModelService final : public v1::ModelService::WithRawCallbackMethod_UploadModelVersion<
                               v1::ModelService::CallbackService> {
 public:
  // All arguments must outlive the service. `table` must be the table of `store`. The .cc defines
  // the constructor and the destructor, for the reason that admin_service.h gives.
  ModelService(serving::VersionStore& store, serving::ServingTable& table,
               serving::VersionUploads& uploads, const BlockingWork& blocking,
               security::AccessControl& access);
  ~ModelService() override;

  grpc::ServerUnaryReactor* ListModelVersions(grpc::CallbackServerContext* rpc,
                                              const v1::ListModelVersionsRequest* request,
                                              v1::ListModelVersionsResponse* response) override;
  grpc::ServerUnaryReactor* GetModelVersion(grpc::CallbackServerContext* rpc,
                                            const v1::GetModelVersionRequest* request,
                                            v1::ModelVersion* response) override;
  grpc::ServerUnaryReactor* DeleteModelVersion(grpc::CallbackServerContext* rpc,
                                               const v1::DeleteModelVersionRequest* request,
                                               google::protobuf::Empty* response) override;
  grpc::ServerUnaryReactor* SetModelAlias(grpc::CallbackServerContext* rpc,
                                          const v1::SetModelAliasRequest* request,
                                          v1::ModelAlias* response) override;
  grpc::ServerUnaryReactor* DeleteModelAlias(grpc::CallbackServerContext* rpc,
                                             const v1::DeleteModelAliasRequest* request,
                                             google::protobuf::Empty* response) override;
  grpc::ServerUnaryReactor* GetActionSet(grpc::CallbackServerContext* rpc,
                                         const v1::GetActionSetRequest* request,
                                         v1::ActionSet* response) override;
  grpc::ServerUnaryReactor* LabelAction(grpc::CallbackServerContext* rpc,
                                        const v1::LabelActionRequest* request,
                                        v1::Action* response) override;
  grpc::ServerUnaryReactor* ListEvaluationReports(
      grpc::CallbackServerContext* rpc, const v1::ListEvaluationReportsRequest* request,
      v1::ListEvaluationReportsResponse* response) override;
  grpc::ServerUnaryReactor* GetEvaluationReport(grpc::CallbackServerContext* rpc,
                                                const v1::GetEvaluationReportRequest* request,
                                                v1::EvaluationReport* response) override;
  grpc::ServerWriteReactor<v1::DownloadModelVersionResponse>* DownloadModelVersion(
      grpc::CallbackServerContext* rpc, const v1::DownloadModelVersionRequest* request) override;
  grpc::ServerReadReactor<grpc::ByteBuffer>* UploadModelVersion(
      grpc::CallbackServerContext* rpc, grpc::ByteBuffer* response) override;
  grpc::ServerUnaryReactor* QueryModelUpload(grpc::CallbackServerContext* rpc,
                                             const v1::QueryModelUploadRequest* request,
                                             v1::QueryModelUploadResponse* response) override;

 private:
  serving::VersionStore& store_;
  serving::ServingTable& table_;
  serving::VersionUploads& uploads_;
  const BlockingWork blocking_;
  security::AccessControl& access_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_MODEL_SERVICE_H_
