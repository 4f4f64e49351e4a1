#include "server/jobs/supervisor.h"

#include <sys/random.h>

#include <algorithm>
#include <array>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "model/files/errno_status.h"
#include "server/errors/error_details.h"
#include "server/jobs/job_requests.h"
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

void LogFailure(const char* what, const std::string& job, const absl::Status& status) {
  Log(LogLevel::kError, what, {{"job", job}, {"error", std::string(status.message())}});
}

}  // namespace

std::string NewJobId() {
  // Neither vowels nor digits that look like letters.
  constexpr std::string_view kAlphabet = "bcdfghjkmnpqrstvwxz2346789bcdfgh";
  static_assert(kAlphabet.size() == 32);
  std::array<unsigned char, 16> random{};
  // Never short for so few bytes.
  while (getrandom(random.data(), random.size(), 0) != static_cast<ssize_t>(random.size())) {
  }
  std::string id;
  for (const unsigned char byte : random) id += kAlphabet[byte % kAlphabet.size()];
  return id;
}

absl::StatusOr<std::unique_ptr<Supervisor>> Supervisor::Start(SupervisorOptions options,
                                                              JobStore& store,
                                                              data::DatasetStore& datasets,
                                                              monitoring::MetricRegistry& metrics) {
  std::unique_ptr<Supervisor> supervisor(
      new Supervisor(std::move(options), store, datasets, metrics));
  if (absl::Status status = supervisor->Recover(); !status.ok()) return status;
  for (int i = 0; i < supervisor->options_.max_running_jobs; ++i) {
    supervisor->threads_.emplace_back([s = supervisor.get()] { s->RunJobs(); });
  }
  return supervisor;
}

Supervisor::Supervisor(SupervisorOptions options, JobStore& store, data::DatasetStore& datasets,
                       monitoring::MetricRegistry& metrics)
    : options_(std::move(options)), store_(store), datasets_(datasets) {
  for (const v1::JobState state : kJobStates) {
    gauges_[state] = &metrics.AddGauge("maneuver_jobs", "Jobs by state.",
                                       {{"state", std::string(JobStateLabel(state))}});
  }
}

Supervisor::~Supervisor() { Stop(); }

void Supervisor::Stop() {
  {
    const std::lock_guard lock(mutex_);
    stops_ = true;
    for (const auto& [name, stop] : running_) stop->Stop(StopRequest::Reason::kServerStops);
  }
  changed_.notify_all();
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
  auto interrupted = store_.ListInState(v1::JOB_STATE_RUNNING, std::nullopt);
  if (!interrupted.ok()) return interrupted.status();
  for (v1::Job& job : *interrupted) {
    job.set_state(v1::JOB_STATE_FAILED);
    *job.mutable_end_time() = ToTimestamp(options_.now());
    *job.mutable_error() = errors::ToProto(ServerInterrupted());
    if (absl::Status status = store_.Move(v1::JOB_STATE_RUNNING, job); !status.ok()) return status;
    RemoveJobOutput(FolderOf(job.name()));
    Log(LogLevel::kWarning, "job was interrupted", {{"job", job.name()}});
  }
  // Folders of jobs that were deleted, or never got as far as the store.
  for (fs::directory_iterator entry(options_.folder, error);
       !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const std::string name = absl::StrCat("jobs/", entry->path().filename().string());
    if (!absl::IsNotFound(store_.Get(name).status())) continue;
    std::error_code ignored;
    fs::remove_all(entry->path(), ignored);
  }
  if (error) return files::ErrnoStatus(error.value(), "read", options_.folder);
  CountJobs();
  return absl::OkStatus();
}

fs::path Supervisor::FolderOf(const std::string& name) const {
  return options_.folder / std::string(absl::StripPrefix(name, "jobs/"));
}

absl::StatusOr<v1::Job> Supervisor::Train(const v1::TrainRequest& request) {
  if (absl::Status status = CheckTrainRequest(request); !status.ok()) return status;
  v1::Job job;
  *job.mutable_train() = request;
  return Admit(std::move(job), request.request_id(), RequestDigest(request),
               request.validate_only());
}

absl::StatusOr<v1::Job> Supervisor::Evaluate(const v1::EvaluateRequest& request) {
  if (absl::Status status = CheckEvaluateRequest(request); !status.ok()) return status;
  const std::string digest = RequestDigest(request);
  // An alias may have gone on since the job was first asked for.
  bool found = false;
  auto earlier = EarlierJob(request.request_id(), digest, &found);
  if (found || !earlier.ok()) return earlier;
  const auto model = options_.resolve(request.model());
  if (!model.ok()) return model.status();
  v1::Job job;
  *job.mutable_evaluate() = request;
  job.mutable_evaluate()->set_model(model->version);
  return Admit(std::move(job), request.request_id(), digest, request.validate_only());
}

absl::StatusOr<v1::Job> Supervisor::EarlierJob(const std::string& request_id,
                                               const std::string& digest, bool* found) {
  *found = false;
  if (request_id.empty()) return v1::Job();
  auto earlier = store_.FindRequest(request_id);
  if (!earlier.ok()) return earlier.status();
  if (!*earlier) return v1::Job();
  if ((*earlier)->request_digest != digest) {
    return errors::WithReason(absl::AlreadyExistsError(absl::StrCat(
                                  "request_id was used for a different request, which became ",
                                  (*earlier)->job.name(), "; choose a new one for a new job")),
                              "REQUEST_ID_REUSED", {{"job", (*earlier)->job.name()}});
  }
  *found = true;
  return (*std::move(earlier))->job;
}

absl::StatusOr<v1::Job> Supervisor::Admit(v1::Job job, const std::string& request_id,
                                          const std::string& digest, bool validate_only) {
  {
    const std::lock_guard lock(mutex_);
    bool found = false;
    auto earlier = EarlierJob(request_id, digest, &found);
    if (found || !earlier.ok()) return earlier;
    if (stops_) {
      return errors::WithReason(absl::UnavailableError("the server is stopping"), "SERVER_STOPS");
    }
    for (const std::string& id : DatasetIds(job)) {
      if (!datasets_.Contains(id)) {
        return errors::WithReason(
            absl::NotFoundError(absl::StrCat("there is no datasets/", id, "; upload it first")),
            "DATASET_NOT_FOUND", {{"dataset", absl::StrCat("datasets/", id)}});
      }
    }
    job.set_state(v1::JOB_STATE_PENDING);
    if (validate_only) return job;
    job.set_name(absl::StrCat("jobs/", options_.new_id()));
    *job.mutable_create_time() = ToTimestamp(options_.now());
    if (absl::Status status = store_.Add(job, request_id, digest); !status.ok()) return status;
  }
  changed_.notify_one();
  CountJobs();
  Log(LogLevel::kInfo, "job created", {{"job", job.name()}});
  return job;
}

absl::StatusOr<v1::Job> Supervisor::Get(const std::string& name) { return store_.Get(name); }

absl::StatusOr<JobPage> Supervisor::List(int page_size, const std::string& page_token) {
  return store_.List(page_size, page_token);
}

absl::StatusOr<v1::Job> Supervisor::Cancel(const std::string& name) {
  absl::StatusOr<v1::Job> job;
  {
    const std::lock_guard lock(mutex_);
    job = store_.Get(name);
    if (!job.ok() || HasEnded(job->state())) return job;
    if (const auto running = running_.find(name); running != running_.end()) {
      running->second->Stop(StopRequest::Reason::kCancelled);
      return job;
    }
    job->set_state(v1::JOB_STATE_CANCELLED);
    *job->mutable_end_time() = ToTimestamp(options_.now());
    if (absl::Status status = store_.Move(v1::JOB_STATE_PENDING, *job); !status.ok()) return status;
  }
  CountJobs();
  news_.Publish(name);
  Log(LogLevel::kInfo, "job cancelled before it ran", {{"job", name}});
  return job;
}

absl::Status Supervisor::Delete(const std::string& name) {
  {
    const std::lock_guard lock(mutex_);
    if (running_.contains(name)) {
      return errors::WithReason(
          absl::FailedPreconditionError(absl::StrCat(name, " is running; cancel it first")),
          "JOB_NOT_ENDED");
    }
    absl::Status status = store_.Delete(name);
    if (absl::IsFailedPrecondition(status)) return errors::WithReason(status, "JOB_NOT_ENDED");
    if (!status.ok()) return status;
  }
  std::error_code ignored;  // the next start removes what is left
  fs::remove_all(FolderOf(name), ignored);
  CountJobs();
  news_.Publish(name);
  return absl::OkStatus();
}

absl::Status Supervisor::DeleteDataset(const std::string& id) {
  absl::StatusOr<fs::path> detached;
  {
    const std::lock_guard lock(mutex_);
    for (const v1::JobState state : {v1::JOB_STATE_PENDING, v1::JOB_STATE_RUNNING}) {
      const auto jobs = store_.ListInState(state, std::nullopt);
      if (!jobs.ok()) return jobs.status();
      for (const v1::Job& job : *jobs) {
        const std::vector<std::string> needed = DatasetIds(job);
        if (std::ranges::find(needed, id) == needed.end()) continue;
        return errors::WithReason(absl::FailedPreconditionError(
                                      absl::StrCat("datasets/", id, " is needed by ", job.name(),
                                                   "; wait for it to end, or cancel it")),
                                  "DATASET_IN_USE", {{"job", job.name()}});
      }
    }
    detached = datasets_.Detach(id);
  }
  if (!detached.ok()) return detached.status();
  std::error_code ignored;  // the next start removes what is left
  fs::remove_all(*detached, ignored);
  return absl::OkStatus();
}

void Supervisor::RunJobs() {
  std::unique_lock lock(mutex_);
  while (!stops_) {
    auto pending = store_.ListInState(v1::JOB_STATE_PENDING, 1);
    if (!pending.ok() || pending->empty()) {
      if (!pending.ok()) {
        LogFailure("jobs cannot be read", "", pending.status());
        changed_.wait_for(lock, kRetry);
      } else {
        changed_.wait(lock);
      }
      continue;
    }
    v1::Job& job = pending->front();
    job.set_state(v1::JOB_STATE_RUNNING);
    *job.mutable_start_time() = ToTimestamp(options_.now());
    if (absl::Status status = store_.Move(v1::JOB_STATE_PENDING, job); !status.ok()) {
      LogFailure("job cannot be started", job.name(), status);
      changed_.wait_for(lock, kRetry);
      continue;
    }
    const auto stop = std::make_shared<StopRequest>();
    running_[job.name()] = stop;
    lock.unlock();
    RunOne(job, *stop);
    lock.lock();
  }
}

void Supervisor::RunOne(const v1::Job& job, StopRequest& stop) {
  Log(LogLevel::kInfo, "job started", {{"job", job.name()}});
  CountJobs();
  const JobRunEnvironment environment = {.trainer = options_.trainer,
                                         .trainer_threads = options_.trainer_threads,
                                         .datasets = &datasets_,
                                         .publish = options_.publish,
                                         .resolve = options_.resolve,
                                         .patience = options_.patience};
  ProgressRecorder progress(store_, news_, job.name(), job.progress().sequence(), options_.now);
  v1::Job ended = RunJob(job, FolderOf(job.name()), environment, stop, progress);
  *ended.mutable_end_time() = ToTimestamp(options_.now());
  Log(ended.has_error() ? LogLevel::kWarning : LogLevel::kInfo, "job ended",
      {{"job", ended.name()},
       {"state", std::string(JobStateLabel(ended.state()))},
       {"error", ended.error().message()}});
  MoveToEnd(std::move(ended));
}

void Supervisor::MoveToEnd(v1::Job job) {
  {
    std::unique_lock lock(mutex_);
    for (;;) {
      const absl::Status status = store_.Move(v1::JOB_STATE_RUNNING, job);
      if (status.ok()) break;
      LogFailure("end of a job not stored", job.name(), status);
      // The next start will find it RUNNING and mark it.
      if (stops_) break;
      changed_.wait_for(lock, kRetry);
    }
    running_.erase(job.name());
  }
  CountJobs();
  news_.Publish(job.name());
}

void Supervisor::CountJobs() {
  for (const auto& [state, gauge] : gauges_) {
    const auto count = store_.CountInState(state);
    if (count.ok()) gauge->Set(static_cast<double>(*count));
  }
}

}  // namespace maneuver::jobs
