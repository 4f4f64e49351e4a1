// The part of Supervisor that answers requests.

#include <sys/random.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <optional>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/training_presets.h"
#include "model/files/file_system_failure.h"
#include "server/errors/error_details.h"
#include "server/jobs/job_folder.h"
#include "server/jobs/job_memory.h"
#include "server/jobs/job_requests.h"
#include "server/jobs/job_settings.h"
#include "server/jobs/job_state.h"
#include "server/jobs/job_time.h"
#include "server/jobs/supervisor.h"
#include "server/jobs/trainer_outcome.h"
#include "server/monitoring/logging.h"

namespace maneuver::jobs {
namespace {

namespace fs = std::filesystem;
using monitoring::Log;
using monitoring::LogLevel;

// Jobs take minutes at the least.
constexpr std::chrono::seconds kRetryWhenFull{60};
// To cancel a job that other servers move meanwhile.
constexpr int kMostTries = 5;

absl::Status Stopping() {
  return errors::WithReason(absl::UnavailableError("the server is stopping"), "SERVER_STOPS");
}

// Fills in what the request leaves to the preset, or to the version to start from, so that who only
// asks sees what a job would learn with.
void ShowEffective(const std::optional<v1::ModelSpec>& start, v1::TrainingSettings& settings) {
  settings = start ? artifact::ResolveTrainingSettings(settings, *start)
                   : artifact::ResolveTrainingSettings(settings);
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

absl::StatusOr<v1::Job> Supervisor::Train(const v1::TrainRequest& request) {
  if (absl::Status status = CheckTrainRequest(request); !status.ok()) return status;
  if (absl::Status status = CheckDevice(request.settings()); !status.ok()) return status;
  const std::string digest = RequestDigest(request);
  v1::Job job;
  *job.mutable_train() = request;
  std::optional<v1::ModelSpec> spec;  // of the version to start from
  if (!request.start_from().empty()) {
    // An alias may have gone on since the job was first asked for.
    bool found = false;
    auto earlier = EarlierJob(request.request_id(), digest, &found);
    if (found || !earlier.ok()) return earlier;
    const auto start = ResolveReference(versions_, request.start_from());
    if (!start.ok()) return start.status();
    const auto manifest = artifact::ReadModelManifest(start->folder);
    if (!manifest.ok()) return WithDefaultReason(manifest.status(), "MODEL_UNAVAILABLE");
    absl::Status status = CheckStart(request, manifest->spec());
    if (!status.ok()) return status;
    job.mutable_train()->set_start_from(start->name.ToString());
    spec = manifest->spec();
  }
  v1::Job complete = job;
  ShowEffective(spec, *complete.mutable_train()->mutable_settings());
  const v1::ModelSpec learned = complete.train().settings().model();
  if (request.validate_only()) {
    job = std::move(complete);
  } else {
    AddNeed(complete, learned, job);
  }
  return WithMemory(Admit(std::move(job), request.request_id(), digest, request.validate_only()),
                    learned);
}

absl::StatusOr<v1::Job> Supervisor::Evaluate(const v1::EvaluateRequest& request) {
  if (absl::Status status = CheckEvaluateRequest(request); !status.ok()) return status;
  const std::string digest = RequestDigest(request);
  // An alias may have gone on since the job was first asked for.
  bool found = false;
  auto earlier = EarlierJob(request.request_id(), digest, &found);
  if (found || !earlier.ok()) return earlier;
  const auto model = ResolveReference(versions_, request.model());
  if (!model.ok()) return model.status();
  v1::Job job;
  *job.mutable_evaluate() = request;
  job.mutable_evaluate()->set_model(model->name.ToString());
  v1::ModelSpec spec;
  if (request.validate_only() || IsShared()) {
    const auto manifest = artifact::ReadModelManifest(model->folder);
    if (!manifest.ok()) return WithDefaultReason(manifest.status(), "MODEL_UNAVAILABLE");
    spec = manifest->spec();
  }
  if (!request.validate_only()) AddNeed(v1::Job(job), spec, job);
  return WithMemory(Admit(std::move(job), request.request_id(), digest, request.validate_only()),
                    spec);
}

absl::StatusOr<v1::Job> Supervisor::Recalibrate(const v1::RecalibrateRequest& request) {
  if (absl::Status status = CheckRecalibrateRequest(request); !status.ok()) return status;
  const std::string digest = RequestDigest(request);
  // An alias may have gone on since the job was first asked for.
  bool found = false;
  auto earlier = EarlierJob(request.request_id(), digest, &found);
  if (found || !earlier.ok()) return earlier;
  const auto model = ResolveReference(versions_, request.model());
  if (!model.ok()) return model.status();
  const auto manifest = artifact::ReadModelManifest(model->folder);
  if (!manifest.ok()) return WithDefaultReason(manifest.status(), "MODEL_UNAVAILABLE");
  v1::Job job;
  *job.mutable_recalibrate() = request;
  job.mutable_recalibrate()->set_model(model->name.ToString());
  if (request.validate_only()) {
    *job.mutable_recalibrate()->mutable_examples() = ResolveExamples(request.examples());
  } else {
    AddNeed(v1::Job(job), manifest->spec(), job);
  }
  return WithMemory(Admit(std::move(job), request.request_id(), digest, request.validate_only()),
                    manifest->spec());
}

absl::StatusOr<v1::Job> Supervisor::CrossValidate(const v1::CrossValidateRequest& request) {
  if (absl::Status status = CheckCrossValidateRequest(request); !status.ok()) return status;
  if (absl::Status status = CheckDevice(request.settings()); !status.ok()) return status;
  v1::Job job;
  *job.mutable_cross_validate() = request;
  v1::Job complete = job;
  ShowEffective(std::nullopt, *complete.mutable_cross_validate()->mutable_settings());
  const v1::ModelSpec learned = complete.cross_validate().settings().model();
  if (request.validate_only()) {
    job = std::move(complete);
  } else {
    AddNeed(complete, learned, job);
  }
  return WithMemory(
      Admit(std::move(job), request.request_id(), RequestDigest(request), request.validate_only()),
      learned);
}

absl::StatusOr<v1::Job> Supervisor::WithMemory(absl::StatusOr<v1::Job> job,
                                               const v1::ModelSpec& spec) const {
  if (!job.ok() || !job->name().empty()) return job;
  auto memory = EstimateMemory(*job, spec, datasets_, options_.limits.data_memory);
  if (!memory.ok()) return memory.status();
  *job->mutable_memory() = *std::move(memory);
  return job;
}

void Supervisor::AddNeed(const v1::Job& complete, const v1::ModelSpec& spec, v1::Job& job) const {
  if (!IsShared()) return;
  auto memory = EstimateMemory(complete, spec, datasets_, options_.limits.data_memory);
  if (memory.ok()) *job.mutable_memory() = *std::move(memory);
}

absl::Status Supervisor::CheckDevice(const v1::TrainingSettings& settings) {
  // Another server may have it: the job waits for one that does.
  return IsShared() ? absl::OkStatus() : devices_.Check(settings.device());
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

absl::Status Supervisor::CheckDatasets(const v1::Job& job) const {
  for (const std::string& id : DatasetIds(job)) {
    const absl::Status exists = datasets_.CheckExists(id);
    if (exists.ok()) continue;
    if (files::IsFileSystemFailure(exists)) return errors::WithFolderReason(exists, "datasets");
    if (errors::IsStoreAway(exists)) return exists;
    if (absl::IsDataLoss(exists)) return errors::WithReason(exists, "DATASET_DAMAGED");
    return errors::WithReason(
        absl::NotFoundError(absl::StrCat("there is no datasets/", id, "; upload it first")),
        "DATASET_NOT_FOUND", {{"dataset", absl::StrCat("datasets/", id)}});
  }
  return absl::OkStatus();
}

absl::Status Supervisor::CheckRoom() const {
  const auto pending = store_.CountInState(v1::JOB_STATE_PENDING);
  if (!pending.ok()) return pending.status();
  if (*pending < options_.max_pending_jobs) return absl::OkStatus();
  return errors::WithRetryDelay(
      errors::WithReason(absl::ResourceExhaustedError(
                             absl::StrCat(*pending,
                                          " jobs wait, as many as this server lets wait; wait, or "
                                          "cancel jobs that are no longer needed")),
                         "TOO_MANY_JOBS"),
      kRetryWhenFull);
}

absl::StatusOr<v1::Job> Supervisor::Admit(v1::Job job, const std::string& request_id,
                                          const std::string& digest, bool validate_only) {
  {
    const MutexLock lock(mutex_);
    bool found = false;
    auto earlier = EarlierJob(request_id, digest, &found);
    if (found || !earlier.ok()) return earlier;
    if (stops_) return Stopping();
    if (absl::Status status = CheckDatasets(job); !status.ok()) return status;
    if (job.has_tag()) {
      if (absl::Status status = CheckTags(job); !status.ok()) return status;
    }
    job.set_state(v1::JOB_STATE_PENDING);
    if (absl::Status status = CheckRoom(); !status.ok()) return status;
    if (validate_only) return job;
    job.set_name(absl::StrCat("jobs/", options_.new_id()));
    *job.mutable_create_time() = ToTimestamp(options_.now());
    absl::Status status = EnsureSettings(job, versions_, FolderOf(job.name()));
    bool made_tags = false;
    if (status.ok() && job.has_tag()) status = BeginTags(job, &made_tags);
    if (status.ok()) status = store_.Add(job, request_id, digest);
    if (!status.ok()) {
      if (made_tags) WithdrawTags(job);
      // If only the store's answer was lost, another server may run the job by now.
      if (!IsShared() || !errors::IsStoreAway(status)) {
        std::error_code ignored;  // the next start removes what is left
        fs::remove_all(FolderOf(job.name()), ignored);
      }
      if (absl::IsPermissionDenied(status)) {
        // The server's, not the caller's.
        return errors::WithReason(absl::InternalError(status.message()), "STORAGE_INACCESSIBLE");
      }
      if (!absl::IsAlreadyExists(status)) return status;
      // Another server has just admitted it.
      earlier = EarlierJob(request_id, digest, &found);
      return found || !earlier.ok() ? earlier : status;
    }
  }
  changed_.NotifyOne();
  CountJobs();
  Log(LogLevel::kInfo, "job created", {{"job", job.name()}});
  workers_.ExplainWaiting({&job});
  if (job.has_error()) {
    Log(LogLevel::kWarning, "job waits", {{"job", job.name()}, {"reason", job.error().message()}});
  }
  return job;
}

absl::StatusOr<v1::Job> Supervisor::Get(const std::string& name) {
  auto job = store_.Get(name);
  if (job.ok()) workers_.ExplainWaiting({&*job});
  return job;
}

absl::StatusOr<JobPage> Supervisor::List(int page_size, const std::string& page_token) {
  auto page = store_.List(page_size, page_token);
  if (!page.ok()) return page;
  std::vector<v1::Job*> jobs;
  for (v1::Job& job : page->jobs) jobs.push_back(&job);
  workers_.ExplainWaiting(jobs);
  // From the end, so that the places before stay as they are.
  for (auto damaged = page->damaged.rbegin(); damaged != page->damaged.rend(); ++damaged) {
    v1::Job job;
    job.set_name(damaged->name);
    *job.mutable_error() = errors::ToProto(errors::WithStorageReason(damaged->error));
    page->jobs.insert(page->jobs.begin() + static_cast<ptrdiff_t>(damaged->newer), std::move(job));
  }
  return page;
}

absl::StatusOr<v1::Job> Supervisor::Cancel(const std::string& name) {
  absl::StatusOr<v1::Job> job;
  int tries = 0;
  do {
    const MutexLock lock(mutex_);
    job = store_.Get(name);
    if (!job.ok() || HasEnded(job->state())) return job;
    if (job->state() == v1::JOB_STATE_RUNNING) {
      // Stored first: the server may die before the process does.
      job = store_.RequestCancel(name);
      const auto running = running_.find(name);
      if (job.ok() && running != running_.end()) {
        running->second->Stop(StopRequest::Reason::kCancelled);
      }
      if (!absl::IsFailedPrecondition(job.status())) return job;
    } else {
      job = CancelPending(*std::move(job));
    }
    // Another server may have moved it since Get.
  } while (absl::IsFailedPrecondition(job.status()) && ++tries < kMostTries);
  if (!job.ok()) return job;
  CountEnd(job->state());
  CountJobs();
  news_.Publish(name);
  Log(LogLevel::kInfo, "job cancelled before it ran", {{"job", name}});
  return job;
}

absl::StatusOr<v1::Job> Supervisor::CancelPending(v1::Job job) {
  job.set_state(v1::JOB_STATE_CANCELLED);
  job.clear_error();
  job.clear_last_lines();
  *job.mutable_end_time() = ToTimestamp(options_.now());
  absl::Status status = store_.Move(v1::JOB_STATE_PENDING, job);
  if (!status.ok()) return status;
  return job;
}

absl::StatusOr<v1::Job> Supervisor::Resume(const std::string& name) {
  absl::StatusOr<v1::Job> job;
  {
    const MutexLock lock(mutex_);
    if (stops_) return Stopping();
    job = store_.Get(name);
    if (!job.ok()) return job;
    if (job->cancel_requested()) {
      return errors::WithReason(
          absl::FailedPreconditionError(
              absl::StrCat(name, " is still being stopped; resume it once it is cancelled")),
          "JOB_NOT_ENDED");
    }
    if (!HasEnded(job->state())) return job;
    if (!CanResume(job->state())) {
      return errors::WithReason(
          absl::FailedPreconditionError(absl::StrCat(
              name, " is ", std::string(JobStateLabel(job->state())), "; train again instead")),
          "JOB_NOT_RESUMABLE");
    }
    if (absl::Status status = CheckDatasets(*job); !status.ok()) {
      if (errors::ReasonOf(status) != "DATASET_NOT_FOUND") return status;
      return errors::WithReason(absl::FailedPreconditionError(status.message()),
                                "DATASET_NOT_FOUND");
    }
    const v1::JobState from = job->state();
    job->set_state(v1::JOB_STATE_PENDING);
    job->clear_end_time();
    job->clear_error();
    job->clear_last_lines();
    job->mutable_attempts()->clear_without_progress();
    job->mutable_attempts()->clear_earlier_run_time();
    if (absl::Status status = store_.Move(from, *job); !status.ok()) return status;
  }
  changed_.NotifyOne();
  CountJobs();
  news_.Publish(name);
  Log(LogLevel::kInfo, "job resumed",
      {{"job", name}, {"checkpoint", LastCheckpoint(FolderOf(name))}});
  return job;
}

absl::StatusOr<bool> Supervisor::DropCheckpoints(const std::string& name) {
  const MutexLock lock(mutex_);
  const auto job = store_.Get(name);
  if (!job.ok()) return job.status();
  return HasEnded(job->state()) && RemoveCheckpoints(LatestAttemptFolder(FolderOf(name)));
}

absl::Status Supervisor::Delete(const std::string& name) {
  {
    const MutexLock lock(mutex_);
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
    const MutexLock lock(mutex_);
    for (const v1::JobState state : {v1::JOB_STATE_PENDING, v1::JOB_STATE_RUNNING}) {
      const auto jobs = store_.ListInState(state, std::nullopt);
      // Of the store: the caller would take it for the dataset's.
      if (!jobs.ok()) return errors::WithStorageReason(jobs.status());
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

}  // namespace maneuver::jobs
