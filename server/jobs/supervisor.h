// The queue of jobs, and the threads that run them.

#ifndef MANEUVER_SERVER_JOBS_SUPERVISOR_H_
#define MANEUVER_SERVER_JOBS_SUPERVISOR_H_

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "locks/mutex.h"
#include "maneuver/v1/training_service.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/data/dataset_store.h"
#include "model/tags/tag_store.h"
#include "server/jobs/checkpoints.h"
#include "server/jobs/child_process.h"
#include "server/jobs/job_curves.h"
#include "server/jobs/job_environment.h"
#include "server/jobs/job_store.h"
#include "server/jobs/job_watch.h"
#include "server/jobs/lease_keeper.h"
#include "server/jobs/live_workers.h"
#include "server/jobs/replica_registry.h"
#include "server/jobs/training_devices.h"
#include "server/jobs/worker_capacity.h"
#include "server/monitoring/metrics.h"
#include "server/serving/model_versions.h"

namespace maneuver::jobs {

// Returns a random job id of 16 characters, which no earlier job has with near certainty.
std::string NewJobId();

struct SupervisorOptions {
  std::filesystem::path folder;       // DATA/jobs: one folder for each job
  std::filesystem::path tags;         // DATA/tags: one folder for each id
  int64_t tag_quota_bytes = 0;        // as in TagStore
  std::string trainer;                // the maneuver-trainer program
  std::vector<std::string> launcher;  // as in JobRunEnvironment
  JobLimits limits;
  CheckpointOptions checkpoints;
  int least_effective_actions = 0;
  int max_running_jobs = 1;  // 0: others run the jobs
  // Most ranks and most memory of a job that this server takes, if others share the store. A server
  // that is alone takes any job.
  int64_t job_ranks = std::numeric_limits<int64_t>::max();
  int64_t job_memory = std::numeric_limits<int64_t>::max();  // bytes
  int max_pending_jobs = 1'000;
  // As in TrainingDevices: of the drivers for NVIDIA and AMD, and of Windows' Linux.
  std::vector<std::filesystem::path> graphics = {"/dev/nvidiactl", "/dev/kfd", "/dev/dxg"};
  // Time from SIGTERM to SIGKILL for a job that is cancelled or interrupted by Stop.
  std::chrono::milliseconds patience{5'000};
  std::function<absl::Time()> now = absl::Now;
  std::function<std::string()> new_id = NewJobId;
};

// Runs jobs in order of their priority and, among equals, of their creation, each in a process of
// its own. A process that dies is followed by another one that continues from its last checkpoint.
// Supervisors of several servers may share a store and a folder: each job runs on one of them, and
// all of them answer about it. If that server goes, another one continues the job.
// Safe to use from any thread; calls write to the store and may wait for the disk. Errors carry
// ErrorInfo or BadRequest.
class Supervisor {
 public:
  // Recovers from an earlier server: makes RUNNING jobs whose lease has ended PENDING again, or
  // CANCELLED if they were being cancelled, and removes what they left half-written. Removes the
  // folders of jobs that the store does not know. Then starts to run pending jobs. All references
  // must outlive the supervisor.
  //   replicas: lists the servers that share the store, and must outlive the supervisor, too;
  //     nullptr: there are no others
  static absl::StatusOr<std::unique_ptr<Supervisor>> Start(
      SupervisorOptions options, JobStore& store, data::DatasetStore& datasets,
      serving::ModelVersions& versions,
      monitoring::MetricRegistry& metrics = monitoring::MetricRegistry::Null(),
      ReplicaRegistry* replicas = nullptr);
  // Stops, if Stop was not called.
  ~Supervisor();

  // Starts no further job and interrupts the running ones: they write a checkpoint and become
  // PENDING, like the jobs that wait for the next start. Returns once all processes are gone, after
  // `patience` at the latest. From then on no job can be created or resumed (UNAVAILABLE);
  // everything else still works.
  void Stop();
  // Returns whether Stop has finished: no job continues before the next start.
  bool IsStopped() const { return is_stopped_; }

  // Returns what this server has for jobs; nothing if it runs none, or none any more. May ask the
  // trainer for its devices: see TrainingDevices.
  std::optional<WorkerCapacity> Capacity();

  // Creates a PENDING job, or returns the existing job with the same request_id. Its settings are
  // resolved now (job_settings.h), and its train.start_from becomes the version that the reference
  // points to now.
  // Errors: INVALID_ARGUMENT, also for a device that the trainer does not have; NOT_FOUND for an
  // unknown dataset or model; ALREADY_EXISTS if request_id was used for a different request;
  // RESOURCE_EXHAUSTED while max_pending_jobs wait, or if the disk is full.
  // With validate_only it returns a job without a name but with its memory, and starts nothing.
  absl::StatusOr<v1::Job> Train(const v1::TrainRequest& request);
  // Creates an evaluation job, as Train does. Its evaluate.model becomes the version that the
  // reference points to now. FAILED_PRECONDITION if the reference is empty and not exactly one
  // model serves.
  absl::StatusOr<v1::Job> Evaluate(const v1::EvaluateRequest& request);
  // Creates a cross-validation job, as Train does.
  absl::StatusOr<v1::Job> CrossValidate(const v1::CrossValidateRequest& request);
  // Creates a recalibration job, as Evaluate does.
  absl::StatusOr<v1::Job> Recalibrate(const v1::RecalibrateRequest& request);
  // Creates a tagging job and the folder of its tags, as Train does. Its tag.model becomes the
  // version that the reference points to now. More errors: ALREADY_EXISTS if the tags exist with
  // another version, datasets, windows or stride; RESOURCE_EXHAUSTED if the quota is used up.
  absl::StatusOr<v1::Job> Tag(const v1::TagRequest& request);

  // Returns a job. If it is PENDING, and no live server can run it, its error says why.
  absl::StatusOr<v1::Job> Get(const std::string& name);
  // Lists jobs, newest first, each as Get returns it. A damaged job, which Get refuses, has its
  // name and its error (STORAGE_DAMAGED) alone.
  absl::StatusOr<JobPage> List(int page_size, const std::string& page_token);
  // Cancels a job. A pending job becomes CANCELLED at once. A running job is asked to stop and
  // stays RUNNING until its process is gone, even if the server dies in between; its checkpoints
  // stay. An ended job is returned unchanged.
  absl::StatusOr<v1::Job> Cancel(const std::string& name);
  // Makes a FAILED or CANCELLED job PENDING again. It continues from its last checkpoint, and its
  // run time counts from 0. A PENDING or RUNNING job is returned as it is. FAILED_PRECONDITION if
  // it has SUCCEEDED, is being stopped, or one of its datasets is gone.
  absl::StatusOr<v1::Job> Resume(const std::string& name);
  // Forgets an ended job and removes its folder. FAILED_PRECONDITION if it has not ended.
  absl::Status Delete(const std::string& name);

  // Removes the checkpoints of an ended job, which then starts anew if it is resumed. Returns
  // whether there were any; false for a job that has not ended.
  absl::StatusOr<bool> DropCheckpoints(const std::string& name);

  // Removes a dataset. FAILED_PRECONDITION while a pending or running job needs it.
  absl::Status DeleteDataset(const std::string& id);
  // Removes tags. FAILED_PRECONDITION while a pending or running job writes them.
  absl::Status DeleteTags(const std::string& id);

  // Announces new events of jobs. To follow a job, first subscribe, then read the store.
  JobNews& news() { return news_; }
  JobStore& store() { return store_; }
  const tags::TagStore& tag_store() const { return tags_; }

 private:
  Supervisor(SupervisorOptions options, JobStore& store, data::DatasetStore& datasets,
             serving::ModelVersions& versions, monitoring::MetricRegistry& metrics,
             ReplicaRegistry* replicas);

  absl::Status Recover();
  // Removes the folders of jobs that were deleted, or never got as far as the store.
  absl::Status RemoveUnknownFolders();
  // Makes RUNNING jobs whose lease has ended PENDING, or CANCELLED if that was asked for.
  absl::Status TakeAbandoned();
  // Makes a RUNNING job PENDING, or CANCELLED if that was asked for. Its worker is gone.
  void GiveUpAttempt(v1::Job& job) const;
  // Does what other servers' changes ask for; called regularly, by one thread, if there may be
  // others.
  void Follow() ABSL_LOCKS_EXCLUDED(mutex_);
  absl::StatusOr<v1::Job> Admit(v1::Job job, const std::string& request_id,
                                const std::string& digest, bool validate_only);
  // Adds the memory that a job will take, if it was only validated.
  //   spec: the spec of its model
  absl::StatusOr<v1::Job> WithMemory(absl::StatusOr<v1::Job> job, const v1::ModelSpec& spec) const;
  // Adds the memory to a job that other servers may run, for those that choose by it. What the job
  // lacks shows when it is admitted.
  //   complete: the job with complete settings
  void AddNeed(const v1::Job& complete, const v1::ModelSpec& spec, v1::Job& job) const;
  // INVALID_ARGUMENT if no server that could run the job has the device.
  absl::Status CheckDevice(const v1::TrainingSettings& settings);
  // FAILED_PRECONDITION if the job is no longer PENDING.
  absl::StatusOr<v1::Job> CancelPending(v1::Job job);
  absl::StatusOr<v1::Job> EarlierJob(const std::string& request_id, const std::string& digest,
                                     bool* found);
  // NOT_FOUND if a dataset that the job reads does not exist.
  absl::Status CheckDatasets(const v1::Job& job) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Returns whether BeginTags can succeed.
  absl::Status CheckTags(const v1::Job& job) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Makes the folder of the job's tags, unless it is there.
  //   made: set to whether this call made it
  absl::Status BeginTags(const v1::Job& job, bool* made) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Removes what BeginTags made, for a job that is refused after all. Tags that another server may
  // write meanwhile stay.
  void WithdrawTags(const v1::Job& job) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // RESOURCE_EXHAUSTED while max_pending_jobs are PENDING.
  absl::Status CheckRoom() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::filesystem::path FolderOf(const std::string& name) const;
  bool IsShared() const { return store_.LeaseTime().has_value(); }

  //   slot: index among the jobs that may run at the same time, from 0
  void RunJobs(int slot) ABSL_LOCKS_EXCLUDED(mutex_);
  void RunOne(const ClaimedJob& claimed, int slot, StopRequest& stop);
  v1::Job Attempt(const ClaimedJob& claimed, int slot, StopRequest& stop);
  // Stores the job in the state in which its attempt left it.
  void EndRun(v1::Job job, const JobLease& lease) ABSL_LOCKS_EXCLUDED(mutex_);
  // Shows how many jobs are in each state, and how many wait for a server that can run them.
  void CountJobs();
  void CountEnd(v1::JobState state) { ends_.at(state)->Increment(); }

  const SupervisorOptions options_;
  JobStore& store_;
  data::DatasetStore& datasets_;
  const tags::TagStore tags_;
  serving::ModelVersions& versions_;
  std::map<v1::JobState, monitoring::Gauge*> gauges_;
  std::map<v1::JobState, monitoring::Counter*> ends_;  // of the states that end a job
  monitoring::Counter& interruptions_;
  LiveWorkers workers_;
  TrainingDevices devices_;
  JobCurves curves_;
  JobNews news_;
  OthersNews others_news_{store_, news_};  // used by Follow
  std::atomic<bool> is_stopped_ = false;

  // Held while a job is admitted, taken, cancelled or deleted, and while a dataset is removed, so
  // that nothing changes between a check and the write that depends on it.
  Mutex mutex_;
  CondVar changed_;
  bool stops_ ABSL_GUARDED_BY(mutex_) = false;
  // The running jobs, by name.
  std::map<std::string, std::shared_ptr<StopRequest>> running_ ABSL_GUARDED_BY(mutex_);

  // Live as long as the server: children die with the thread that started them.
  std::vector<std::thread> threads_;
  // nullptr if leases last as long as the store. Declared last, and so destroyed first, because it
  // calls Follow.
  std::unique_ptr<LeaseKeeper> keeper_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_SUPERVISOR_H_
