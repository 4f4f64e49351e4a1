#include "server/jobs/live_workers.h"

#include <algorithm>
#include <string>

#include "absl/strings/str_cat.h"
#include "server/errors/error_details.h"

namespace maneuver::jobs {

LiveWorkers::LiveWorkers(ReplicaRegistry* replicas, monitoring::MetricRegistry& metrics)
    : replicas_(replicas) {
  if (replicas_ == nullptr) return;
  waiting_ = &metrics.AddGauge("maneuver_jobs_without_worker",
                               "Pending jobs that no live server can run.");
}

absl::StatusOr<std::vector<WorkerCapacity>> LiveWorkers::List() const {
  const auto live = replicas_->ListLive();
  if (!live.ok()) return live.status();
  std::vector<WorkerCapacity> workers;
  for (const v1::Replica& each : *live) {
    if (!each.has_job_capacity()) continue;
    const v1::JobCapacity& has = each.job_capacity();
    workers.push_back(
        {{has.devices().begin(), has.devices().end()}, has.ranks(), has.memory_bytes()});
  }
  return workers;
}

void LiveWorkers::ExplainWaiting(const std::vector<v1::Job*>& jobs) const {
  const auto is_pending = [](const v1::Job* job) { return job->state() == v1::JOB_STATE_PENDING; };
  if (replicas_ == nullptr || std::ranges::none_of(jobs, is_pending)) return;
  const auto workers = List();
  if (!workers.ok()) return;
  for (v1::Job* job : jobs) {
    if (!is_pending(job)) continue;
    const std::string why = WhyNobodyRuns(NeedsOf(*job), *workers);
    if (why.empty()) continue;
    *job->mutable_error() = errors::ToProto(errors::WithReason(
        absl::FailedPreconditionError(absl::StrCat("no server can run it: ", why)), "NO_WORKER"));
  }
}

void LiveWorkers::ShowWaiting(int64_t pending) {
  if (replicas_ == nullptr) return;
  int64_t count = 0;
  if (pending > 0) {
    const auto needs = replicas_->CountPendingNeeds();
    const auto workers = List();
    if (!needs.ok() || !workers.ok()) return;
    for (const auto& [need, jobs] : *needs) {
      if (!WhyNobodyRuns(need, *workers).empty()) count += jobs;
    }
  }
  waiting_->Set(static_cast<double>(count));
}

}  // namespace maneuver::jobs
