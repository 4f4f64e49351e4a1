#ifndef MANEUVER_SERVER_RPC_TRAINING_SERVICE_H_
#define MANEUVER_SERVER_RPC_TRAINING_SERVICE_H_

#include "maneuver/v1/training_service.grpc.pb.h"
#include "server/jobs/supervisor.h"
#include "server/rpc/blocking_call.h"
#include "server/security/access_control.h"

namespace maneuver::rpc {

// Creates, lists, cancels, resumes, deletes and watches jobs.
class TrainingService final : public v1::TrainingService::CallbackService {
 public:
  // All arguments must outlive the service. The .cc defines the constructor and the destructor, for
  // the reason that admin_service.h gives.
  TrainingService(jobs::Supervisor& jobs, const BlockingWork& blocking,
                  security::AccessControl& access);
  ~TrainingService() override;

  grpc::ServerUnaryReactor* Train(grpc::CallbackServerContext* rpc, const v1::TrainRequest* request,
                                  v1::Job* response) override;
  grpc::ServerUnaryReactor* Evaluate(grpc::CallbackServerContext* rpc,
                                     const v1::EvaluateRequest* request,
                                     v1::Job* response) override;
  grpc::ServerUnaryReactor* CrossValidate(grpc::CallbackServerContext* rpc,
                                          const v1::CrossValidateRequest* request,
                                          v1::Job* response) override;
  grpc::ServerUnaryReactor* Recalibrate(grpc::CallbackServerContext* rpc,
                                        const v1::RecalibrateRequest* request,
                                        v1::Job* response) override;
  grpc::ServerUnaryReactor* Tag(grpc::CallbackServerContext* rpc, const v1::TagRequest* request,
                                v1::Job* response) override;
  grpc::ServerUnaryReactor* GetJob(grpc::CallbackServerContext* rpc,
                                   const v1::GetJobRequest* request, v1::Job* response) override;
  grpc::ServerUnaryReactor* ListJobs(grpc::CallbackServerContext* rpc,
                                     const v1::ListJobsRequest* request,
                                     v1::ListJobsResponse* response) override;
  grpc::ServerUnaryReactor* CancelJob(grpc::CallbackServerContext* rpc,
                                      const v1::CancelJobRequest* request,
                                      v1::Job* response) override;
  grpc::ServerUnaryReactor* ResumeJob(grpc::CallbackServerContext* rpc,
                                      const v1::ResumeJobRequest* request,
                                      v1::Job* response) override;
  grpc::ServerUnaryReactor* DeleteJob(grpc::CallbackServerContext* rpc,
                                      const v1::DeleteJobRequest* request,
                                      google::protobuf::Empty* response) override;
  grpc::ServerWriteReactor<v1::WatchJobResponse>* WatchJob(
      grpc::CallbackServerContext* rpc, const v1::WatchJobRequest* request) override;

 private:
  jobs::Supervisor& jobs_;
  const BlockingWork blocking_;
  security::AccessControl& access_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_TRAINING_SERVICE_H_
