#ifndef MANEUVER_SERVER_RPC_OUTCOME_SERVICE_H_
#define MANEUVER_SERVER_RPC_OUTCOME_SERVICE_H_

#include <atomic>
#include <cstdint>

#include "maneuver/v1/outcome_service.grpc.pb.h"
#include "server/rpc/outcome_dataset.h"
#include "server/rpc/prediction_run.h"
#include "server/rpc/worker_pool.h"
#include "server/serving/outcome_metrics.h"

namespace maneuver::rpc {

// Scores reported outcomes. Refuses requests with the reason TOO_MANY_REQUESTS while those that
// wait or are being scored have 128 MiB in all.
class OutcomeService final : public v1::OutcomeService::CallbackService {
 public:
  // All arguments must outlive the service. The .cc defines the constructor and the destructor, for
  // the reason that admin_service.h gives.
  //   scoring: threads that score outcomes
  //   storage: where outcomes are collected
  OutcomeService(PredictionContext& context, serving::OutcomeMetrics& metrics, WorkerPool& scoring,
                 const OutcomeStorage& storage = {});
  ~OutcomeService() override;

  grpc::ServerUnaryReactor* ReportOutcomes(grpc::CallbackServerContext* rpc,
                                           const v1::ReportOutcomesRequest* request,
                                           v1::ReportOutcomesResponse* response) override;
  grpc::ServerUnaryReactor* CollectOutcomes(grpc::CallbackServerContext* rpc,
                                            const v1::CollectOutcomesRequest* request,
                                            v1::CollectOutcomesResponse* response) override;

 private:
  PredictionContext& context_;
  serving::OutcomeMetrics& metrics_;
  WorkerPool& scoring_;
  const OutcomeStorage storage_;
  std::atomic<int64_t> bytes_ = 0;  // of the requests that wait or are being scored
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_OUTCOME_SERVICE_H_
