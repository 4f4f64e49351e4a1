#ifndef MANEUVER_SERVER_RPC_OUTCOME_SERVICE_H_
#define MANEUVER_SERVER_RPC_OUTCOME_SERVICE_H_

#include "maneuver/v1/outcome_service.grpc.pb.h"
#include "server/rpc/blocking_call.h"
#include "server/rpc/open_streams.h"
#include "server/rpc/outcome_dataset.h"
#include "server/rpc/outcome_scorer.h"
#include "server/rpc/prediction_run.h"
#include "server/rpc/worker_pool.h"
#include "server/serving/outcome_metrics.h"

namespace maneuver::rpc {

// StreamOutcomes reads bytes, so that a report that cannot be parsed is answered as such.
using OutcomeMethods = v1::OutcomeService::WithCallbackMethod_ReportOutcomes<
    v1::OutcomeService::WithRawCallbackMethod_StreamOutcomes<
        v1::OutcomeService::WithCallbackMethod_CollectOutcomes<v1::OutcomeService::Service>>>;

// Scores reported outcomes, and makes datasets of them. Refuses reports with the reason
// TOO_MANY_REQUESTS while those that wait or are being scored have 128 MiB in all.
class OutcomeService final : public OutcomeMethods {
 public:
  // All arguments must outlive the service. The .cc defines the constructor and the destructor, for
  // the reason that admin_service.h gives.
  //   scoring: the thread that scores outcomes
  //   storage: where outcomes are collected
  OutcomeService(PredictionContext& context, serving::OutcomeMetrics& metrics, WorkerPool& scoring,
                 const OutcomeStorage& storage = {});
  ~OutcomeService() override;

  grpc::ServerUnaryReactor* ReportOutcomes(grpc::CallbackServerContext* rpc,
                                           const v1::ReportOutcomesRequest* request,
                                           v1::ReportOutcomesResponse* response) override;
  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* StreamOutcomes(
      grpc::CallbackServerContext* rpc) override;
  grpc::ServerUnaryReactor* CollectOutcomes(grpc::CallbackServerContext* rpc,
                                            const v1::CollectOutcomesRequest* request,
                                            v1::CollectOutcomesResponse* response) override;

  // Ends the streams once the report that each is at is answered. Call it just before the server
  // refuses new calls.
  void Drain() { streams_.Drain(); }
  // Returns whether a report waits or is being scored.
  bool HasReports() const { return scorer_.HasReports(); }

 private:
  const BlockingWork blocking_;
  const OutcomeStorage storage_;
  OutcomeScorer scorer_;
  OpenStreams streams_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_OUTCOME_SERVICE_H_
