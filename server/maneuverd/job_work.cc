#include "server/maneuverd/job_work.h"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "absl/strings/str_split.h"
#include "absl/time/time.h"

namespace maneuver {
namespace {

const absl::Duration kBetweenSweeps = absl::Hours(1);

jobs::SupervisorOptions SupervisorOptionsFor(const ServerOptions& options) {
  jobs::SupervisorOptions supervisor;
  supervisor.folder = options.data_dir / "jobs";
  supervisor.tags = options.data_dir / "tags";
  supervisor.tag_quota_bytes = options.jobs.tag_quota_bytes;
  supervisor.trainer = options.jobs.trainer;
  supervisor.launcher = absl::StrSplit(options.jobs.trainer_command, ' ', absl::SkipEmpty());
  supervisor.limits = options.jobs.limits;
  supervisor.checkpoints = options.jobs.checkpoints;
  supervisor.least_effective_actions = options.jobs.least_effective_actions;
  supervisor.max_running_jobs = RunsJobs(options.role) ? options.jobs.max_running : 0;
  supervisor.job_ranks = RanksForAJob(options.jobs);
  supervisor.job_memory = MemoryForAJob(options.jobs);
  supervisor.max_pending_jobs = options.jobs.max_pending;
  supervisor.patience = PatienceWithTrainers(options);
  return supervisor;
}

}  // namespace

std::chrono::milliseconds PatienceWithTrainers(const ServerOptions& options) {
  // A trainer that ignores SIGTERM must not hold up the end of a server that others call. Where
  // nobody calls, its last checkpoint comes first.
  if (options.role == Role::kWork) return options.shutdown_timeout;
  return std::min<std::chrono::milliseconds>(jobs::SupervisorOptions{}.patience,
                                             options.shutdown_timeout);
}

JobWork::JobWork(const ServerOptions& options, Storage& storage)
    : versions_(*storage.versions, *storage.models),
      version_uploads_(options.data_dir / "models", *storage.versions, *storage.models,
                       options.datasets.keep_uploads, options.is_shared) {}

absl::StatusOr<std::unique_ptr<JobWork>> JobWork::Start(const ServerOptions& options,
                                                        Storage& storage,
                                                        monitoring::MetricRegistry& metrics) {
  std::unique_ptr<JobWork> work(new JobWork(options, storage));
  auto supervisor =
      jobs::Supervisor::Start(SupervisorOptionsFor(options), *storage.store, *storage.datasets,
                              work->versions_, metrics, storage.store->Replicas());
  if (!supervisor.ok()) return supervisor.status();
  work->supervisor_ = *std::move(supervisor);
  jobs::Retention& retention =
      work->retention_.emplace(options.jobs.retention, *work->supervisor_, work->versions_);
  const auto now = [] { return std::filesystem::file_time_type::clock::now(); };
  retention.AlsoSweep(
      [now, &datasets = *storage.datasets] { return datasets.RemoveAbandonedUploads(now()); });
  retention.AlsoSweep([&datasets = *storage.datasets] { return datasets.AdoptFolders(); });
  retention.AlsoSweep(
      [now, &uploads = work->version_uploads_] { return uploads.RemoveAbandoned(now()); });
  retention.SweepRegularly(kBetweenSweeps);
  return work;
}

}  // namespace maneuver
