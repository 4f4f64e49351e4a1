// The gRPC services of a server, and what they share: the scheduler, memory and threads.

#ifndef MANEUVER_SERVER_MANEUVERD_SERVICES_H_
#define MANEUVER_SERVER_MANEUVERD_SERVICES_H_

#include <memory>
#include <optional>
#include <vector>

#include "server/maneuverd/job_work.h"
#include "server/maneuverd/options.h"
#include "server/maneuverd/storage.h"
#include "server/monitoring/metrics.h"
#include "server/rpc/admin_service.h"
#include "server/rpc/dataset_service.h"
#include "server/rpc/guarded_service.h"
#include "server/rpc/message_gate.h"
#include "server/rpc/model_service.h"
#include "server/rpc/outcome_service.h"
#include "server/rpc/prediction_service.h"
#include "server/rpc/replica_service.h"
#include "server/rpc/tag_service.h"
#include "server/rpc/training_service.h"
#include "server/rpc/worker_pool.h"
#include "server/security/access_control.h"
#include "server/serving/batch_scheduler.h"
#include "server/serving/map_cache.h"
#include "server/serving/memory_budget.h"
#include "server/serving/outcome_metrics.h"
#include "server/serving/past_answers.h"
#include "server/serving/send_memory.h"

namespace maneuver {

class Services {
 public:
  // All arguments must outlive the services.
  Services(const ServerOptions& options, Storage& storage, JobWork& job_work,
           security::AccessControl& access, monitoring::MetricRegistry& metrics);

  // Returns what rpc::Server::Start takes: each service, with what stands before its calls.
  std::vector<rpc::NamedService> ForServer();

  // Bounds the memory of large requests that are received at `port`. Call it once the server listens.
  //
  // Bounds how many are received at once, each counted as the largest that may come. They have what
  // is free below 60 % of the memory's limit, but at least an eighth of the limit. While twice the
  // bytes of the last seconds would fit there is no bound: requests whose bytes do not come take no
  // memory. Above 90 % of the limit, closes the connections that sent the most in the last seconds,
  // until the others have sent no more than that eighth.
  void BoundLargeRequests(int port);

  // Ends the streams once what they are at is answered. Call it just before new calls are refused.
  void Drain();

 private:
  // Each may need those before it, and ends before them.
  const ServerOptions& options_;
  rpc::MessageGate message_gate_;
  serving::MemoryBudget memory_;
  serving::SendMemory send_memory_;  // outlives the calls, which hold shares of it
  serving::BatchScheduler scheduler_;
  rpc::WorkerPool disk_;
  rpc::WorkerPool loading_;
  serving::MapCache maps_;
  std::optional<serving::PastAnswers> past_answers_;
  rpc::PredictionContext context_;
  rpc::PredictionService predictions_;
  const rpc::BlockingWork blocking_;
  rpc::ModelService models_;
  rpc::ReplicaService replicas_;
  rpc::DatasetService datasets_;
  rpc::TrainingService training_;
  rpc::TagService tags_;
  serving::OutcomeMetrics outcome_metrics_;
  rpc::WorkerPool scoring_;
  rpc::OutcomeService outcomes_;
  rpc::AdminService admin_;
};

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_SERVICES_H_
