#ifndef MANEUVER_SERVER_RPC_OUTCOME_SCORER_H_
#define MANEUVER_SERVER_RPC_OUTCOME_SCORER_H_

#include <grpcpp/server_context.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "absl/status/status.h"
#include "maneuver/v1/outcome_service.pb.h"
#include "server/rpc/outcome_dataset.h"
#include "server/rpc/prediction_run.h"
#include "server/rpc/recent_reports.h"
#include "server/rpc/worker_pool.h"
#include "server/security/access_control.h"
#include "server/serving/outcome_metrics.h"

namespace maneuver::rpc {

// Scores reports of outcomes that came in one call each, or in a stream. Safe to use from any
// thread.
class OutcomeScorer {
 public:
  static constexpr size_t kMostRequestIdLength = 128;  // characters

  // All arguments must outlive the result.
  //   pool: has one thread; with more, a report that arrives twice at once would count twice
  //   storage: where outcomes are collected
  OutcomeScorer(PredictionContext& context, serving::OutcomeMetrics& metrics, WorkerPool& pool,
                const OutcomeStorage& storage)
      : context_(context), metrics_(metrics), pool_(pool), storage_(storage) {}

  // Reserves memory for a report of this size until the result is gone. Returns nullptr while the
  // reports that wait or are being scored have 128 MiB: refuse it with TooManyWait(). One that is
  // alone may have more.
  std::shared_ptr<void> Reserve(int64_t bytes);
  // Checks what can be checked without computing anything, and the caller's limit of targets.
  absl::Status Admit(const security::Credentials& caller, const v1::ReportOutcomesRequest& report);
  // Scores an admitted report, or finds its answer among those of the last reports. Errors: those
  // of rpc::ReportOutcomes. Call it on a thread of the pool.
  absl::Status Score(const grpc::CallbackServerContext& rpc,
                     const v1::ReportOutcomesRequest& report, v1::ReportOutcomesResponse* response);

  // Returns whether a report waits or is being scored.
  bool HasReports() const { return *bytes_ > 0; }

  security::AccessControl& access() { return context_.access; }
  WorkerPool& pool() { return pool_; }
  serving::SendMemory& send_memory() { return context_.send_memory; }

 private:
  PredictionContext& context_;
  serving::OutcomeMetrics& metrics_;
  WorkerPool& pool_;
  const OutcomeStorage storage_;
  RecentReports recent_{size_t{16} << 20};
  const std::shared_ptr<std::atomic<int64_t>> bytes_ =  // reserved
      std::make_shared<std::atomic<int64_t>>(0);
};

// RESOURCE_EXHAUSTED, reason TOO_MANY_REQUESTS, with a delay.
absl::Status TooManyWait();

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_OUTCOME_SCORER_H_
