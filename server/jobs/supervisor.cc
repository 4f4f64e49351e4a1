#include "server/jobs/supervisor.h"

#include <algorithm>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/files/errno_status.h"
#include "server/errors/error_details.h"
#include "server/jobs/job_attempt.h"
#include "server/jobs/job_folder.h"
#include "server/jobs/job_run.h"
#include "server/jobs/job_state.h"
#include "server/jobs/job_time.h"
#include "server/jobs/progress_recorder.h"
#include "server/jobs/trainer_outcome.h"
#include "server/monitoring/logging.h"
#include "server/security/resource_name.h"

namespace maneuver::jobs {
namespace {

namespace fs = std::filesystem;
using monitoring::Log;
using monitoring::LogLevel;

// Between two attempts to write the end of a job to a store that refuses it (a full disk).
constexpr std::chrono::seconds kRetry{1};
// A job is in the store long before its folder is this old.
constexpr std::chrono::hours kUnknownFolderAge{1};

void LogFailure(const char* what, const std::string& job, const absl::Status& status) {
  if (errors::IsStoreAway(status)) return;  // logged by the store
  Log(LogLevel::kError, what, {{"job", job}, {"error", std::string(status.message())}});
}

}  // namespace

absl::StatusOr<std::unique_ptr<Supervisor>> Supervisor::Start(SupervisorOptions options,
                                                              JobStore& store,
                                                              data::DatasetStore& datasets,
                                                              serving::ModelVersions& versions,
                                                              monitoring::MetricRegistry& metrics,
                                                              ReplicaRegistry* replicas) {
  std::unique_ptr<Supervisor> supervisor(
      new Supervisor(std::move(options), store, datasets, versions, metrics, replicas));
  if (absl::Status status = supervisor->Recover(); !status.ok()) return status;
  if (supervisor->IsShared()) {
    supervisor->keeper_ =
        std::make_unique<LeaseKeeper>(store, [s = supervisor.get()] { s->Follow(); });
  }
  for (int i = 0; i < supervisor->options_.max_running_jobs; ++i) {
    supervisor->threads_.emplace_back([s = supervisor.get(), i] { s->RunJobs(i); });
  }
  return supervisor;
}

Supervisor::Supervisor(SupervisorOptions options, JobStore& store, data::DatasetStore& datasets,
                       serving::ModelVersions& versions, monitoring::MetricRegistry& metrics,
                       ReplicaRegistry* replicas)
    : options_(std::move(options)),
      store_(store),
      datasets_(datasets),
      tags_(options_.tags, options_.tag_quota_bytes),
      versions_(versions),
      interruptions_(metrics.AddCounter("maneuver_job_interruptions_total",
                                        "Processes of jobs that died or were cut off.")),
      workers_(replicas, metrics),
      devices_(options_.trainer, options_.graphics),
      curves_(metrics, options_.max_running_jobs) {
  for (const v1::JobState state : kJobStates) {
    gauges_[state] = &metrics.AddGauge("maneuver_jobs", "Jobs by state.",
                                       {{"state", std::string(JobStateLabel(state))}});
    if (!HasEnded(state)) continue;
    ends_[state] = &metrics.AddCounter("maneuver_job_ends_total", "Jobs that ended, by state.",
                                       {{"state", std::string(JobStateLabel(state))}});
  }
}

Supervisor::~Supervisor() { Stop(); }

void Supervisor::Stop() {
  {
    const MutexLock lock(mutex_);
    stops_ = true;
    for (const auto& [name, stop] : running_) stop->Stop(StopRequest::Reason::kServerStops);
  }
  changed_.NotifyAll();
  for (std::thread& thread : threads_) {
    if (thread.joinable()) thread.join();
  }
  is_stopped_ = true;
  news_.PublishAll();
}

absl::Status Supervisor::Recover() {
  std::error_code error;
  fs::create_directories(options_.folder, error);
  if (error) return files::ErrnoStatus(error.value(), "create", options_.folder);
  absl::Status status = TakeAbandoned();
  if (status.ok()) status = RemoveUnknownFolders();
  if (status.ok()) status = tags_.RemoveLeftovers(IsShared());
  if (!status.ok()) return status;
  CountJobs();
  return absl::OkStatus();
}

absl::Status Supervisor::RemoveUnknownFolders() {
  std::error_code error;
  for (fs::directory_iterator entry(options_.folder, error);
       !error && entry != fs::directory_iterator(); entry.increment(error)) {
    std::error_code ignored;
    // Another server may be admitting the job.
    if (IsShared() &&
        fs::file_time_type::clock::now() - entry->last_write_time(ignored) < kUnknownFolderAge) {
      continue;
    }
    const std::string name = absl::StrCat("jobs/", entry->path().filename().string());
    if (!absl::IsNotFound(store_.Get(name).status())) continue;
    fs::remove_all(entry->path(), ignored);
  }
  return error ? files::ErrnoStatus(error.value(), "read", options_.folder) : absl::OkStatus();
}

absl::Status Supervisor::TakeAbandoned() {
  const auto abandoned = store_.TakeAbandoned([this](v1::Job& job) { GiveUpAttempt(job); });
  if (!abandoned.ok()) return abandoned.status();
  for (const v1::Job& job : *abandoned) {
    if (HasEnded(job.state())) CountEnd(job.state());
    Log(LogLevel::kWarning, "job was interrupted",
        {{"job", job.name()}, {"state", std::string(JobStateLabel(job.state()))}});
  }
  return absl::OkStatus();
}

void Supervisor::Follow() {
  if (const absl::Status status = TakeAbandoned(); !status.ok()) {
    LogFailure("jobs of other servers cannot be taken over", "", status);
  }
  CountJobs();
  others_news_.Publish();
  changed_.NotifyAll();  // a job may be pending
}

void Supervisor::GiveUpAttempt(v1::Job& job) const {
  // Nobody knows when it died; it was there when it last reported.
  const absl::Time begun = ToTime(job.attempts().start_time());
  const fs::path folder = LatestAttemptFolder(FolderOf(job.name()));
  EndAttempt(job, folder, std::max(begun, ToTime(job.progress().time())), /*died=*/true);
  // A worker that is slow rather than gone may still write there.
  if (!IsShared()) RemoveJobOutput(folder);
  job.clear_last_lines();  // of an earlier process
  if (job.cancel_requested()) {
    job.set_state(v1::JOB_STATE_CANCELLED);
    job.clear_cancel_requested();
    job.clear_error();
    *job.mutable_end_time() = ToTimestamp(options_.now());
  } else {
    job.set_state(v1::JOB_STATE_PENDING);
    *job.mutable_error() = errors::ToProto(ServerInterrupted());
  }
}

fs::path Supervisor::FolderOf(const std::string& name) const {
  return options_.folder / security::IdOf(name);
}

std::optional<WorkerCapacity> Supervisor::Capacity() {
  if (options_.max_running_jobs == 0 || is_stopped_) return std::nullopt;
  return WorkerCapacity{devices_.Usable(), options_.job_ranks, options_.job_memory};
}

void Supervisor::RunJobs(int slot) {
  MutexLock lock(mutex_);
  while (!stops_) {
    std::optional<WorkerCapacity> capacity;
    if (IsShared()) {
      // Each time: a driver may come after the server, which then tells the others that it has the
      // device. May take seconds.
      lock.Unlock();
      capacity = Capacity();
      lock.Lock();
      if (stops_) break;
    }
    const auto before = std::chrono::steady_clock::now();
    const auto claimed = store_.Claim(
        [this](v1::Job& job) {
          BeginAttempt(job, LatestAttemptFolder(FolderOf(job.name())), options_.now());
        },
        capacity);
    if (!claimed.ok()) {
      LogFailure("no job can be started", "", claimed.status());
      changed_.WaitFor(mutex_, kRetry);
      continue;
    }
    if (!*claimed) {
      changed_.Wait(mutex_);
      continue;
    }
    const auto stop = std::make_shared<StopRequest>();
    running_[(*claimed)->job.name()] = stop;
    if (keeper_ != nullptr) keeper_->Keep((*claimed)->lease, stop, before);
    lock.Unlock();
    RunOne(**claimed, slot, *stop);
    lock.Lock();
  }
}

void Supervisor::RunOne(const ClaimedJob& claimed, int slot, StopRequest& stop) {
  const v1::Job& job = claimed.job;
  Log(LogLevel::kInfo, "job started",
      {{"job", job.name()},
       {"attempt", job.attempts().started()},
       {"checkpoint", job.attempts().checkpoint()}});
  CountJobs();
  v1::Job ended = Attempt(claimed, slot, stop);
  curves_.Clear(slot);
  EndRun(std::move(ended), claimed.lease);
}

v1::Job Supervisor::Attempt(const ClaimedJob& claimed, int slot, StopRequest& stop) {
  const v1::Job& job = claimed.job;
  fs::path folder = FolderOf(job.name());
  if (IsShared() || LatestAttemptFolder(folder) != folder) {
    auto made = MakeAttemptFolder(folder, claimed.lease.fence);
    if (!made.ok()) {
      v1::Job failed = job;
      failed.set_state(v1::JOB_STATE_FAILED);
      *failed.mutable_error() = errors::ToProto(made.status());
      return failed;
    }
    folder = *std::move(made);
  }
  const JobRunEnvironment environment = {
      .trainer = options_.trainer,
      .launcher = options_.launcher,
      .limits = options_.limits,
      .checkpoints = options_.checkpoints,
      .least_effective_actions = options_.least_effective_actions,
      .datasets = &datasets_,
      .tag_store = &tags_,
      .versions = &versions_,
      .patience = options_.patience};
  ProgressRecorder progress(
      store_, news_, job, claimed.lease, options_.now,
      [this, slot](const v1::JobProgress& event) { curves_.Show(slot, event); });
  return RunJob(job, folder,
                {environment, stop, progress, options_.now, {job.name(), claimed.lease.fence}});
}

void Supervisor::EndRun(v1::Job job, const JobLease& lease) {
  absl::Status status;
  {
    MutexLock lock(mutex_);
    const JobEdit end = [&](v1::Job& stored) {
      // Cancelled since it was decided that another process goes on.
      if (job.state() == v1::JOB_STATE_PENDING && stored.cancel_requested()) {
        job.set_state(v1::JOB_STATE_CANCELLED);
        job.clear_error();
        job.clear_last_lines();
      }
      job.clear_cancel_requested();
      if (HasEnded(job.state())) *job.mutable_end_time() = ToTimestamp(options_.now());
      stored = job;
    };
    for (;;) {
      status = store_.Finish(lease, end);
      if (status.ok()) break;
      LogFailure("end of a job not stored", job.name(), status);
      // Whoever finds it without a lease goes on with it. One that is damaged stays so: the jobs
      // after it do not wait for that.
      if (stops_ || absl::IsAborted(status) || absl::IsDataLoss(status)) break;
      changed_.WaitFor(mutex_, kRetry);
    }
    running_.erase(job.name());
    if (keeper_ != nullptr) keeper_->Release(job.name());
  }
  if (!status.ok()) return;
  Log(job.has_error() ? LogLevel::kWarning : LogLevel::kInfo,
      HasEnded(job.state()) ? "job ended" : "job was interrupted",
      {{"job", job.name()},
       {"state", std::string(JobStateLabel(job.state()))},
       {"error", job.error().message()}});
  if (HasEnded(job.state())) {
    CountEnd(job.state());
  } else {
    interruptions_.Increment();
  }
  changed_.NotifyOne();
  CountJobs();
  news_.Publish(job.name());
}

void Supervisor::CountJobs() {
  for (const auto& [state, gauge] : gauges_) {
    const auto count = store_.CountInState(state);
    if (!count.ok()) continue;
    gauge->Set(static_cast<double>(*count));
    if (state == v1::JOB_STATE_PENDING) workers_.ShowWaiting(*count);
  }
}

}  // namespace maneuver::jobs
