// Which of the servers that share a store could run which job.

#ifndef MANEUVER_SERVER_JOBS_LIVE_WORKERS_H_
#define MANEUVER_SERVER_JOBS_LIVE_WORKERS_H_

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/replica_registry.h"
#include "server/jobs/worker_capacity.h"
#include "server/monitoring/metrics.h"

namespace maneuver::jobs {

// Does nothing on a server that is alone: it runs any job. Safe to use from any thread.
class LiveWorkers {
 public:
  //   replicas: nullptr if no other servers share the store; must outlive this object
  LiveWorkers(ReplicaRegistry* replicas, monitoring::MetricRegistry& metrics);

  // Sets the error (NO_WORKER) of each PENDING job that no live server can run.
  void ExplainWaiting(const std::vector<v1::Job*>& jobs) const;
  // Shows how many PENDING jobs no live server can run.
  //   pending: how many jobs are PENDING
  void ShowWaiting(int64_t pending);

 private:
  // Returns what the live servers that run jobs have.
  absl::StatusOr<std::vector<WorkerCapacity>> List() const;

  ReplicaRegistry* const replicas_;
  monitoring::Gauge* waiting_ = nullptr;  // nullptr like replicas_
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_LIVE_WORKERS_H_
