// What is kept of jobs and models, and for how long.

#ifndef MANEUVER_SERVER_JOBS_RETENTION_H_
#define MANEUVER_SERVER_JOBS_RETENTION_H_

#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "server/jobs/supervisor.h"

namespace maneuver::jobs {

struct RetentionPolicy {
  // Jobs are forgotten so long after their end; infinite: never. What they made stays.
  absl::Duration jobs = absl::Hours(24 * 90);
  // Checkpoints of jobs that failed or were cancelled are removed so long after their end.
  absl::Duration checkpoints = absl::Hours(24 * 14);
  // Of each model the newest so many versions stay, and all that an alias names; 0: all of them.
  int versions = 0;
};

// A version of a model, as the policy sees it.
struct KeptVersion {
  std::string model;  // models/{model}
  std::string name;   // models/{model}/versions/{version}
  bool has_alias = false;
};

// The versions that the policy gives up.
//   versions: newest first.
//   needed: names of those that a job which has not ended reads.
std::vector<std::string> VersionsToDelete(const RetentionPolicy& policy,
                                          const std::vector<KeptVersion>& versions,
                                          const std::vector<std::string>& needed);

// The models that the policy is applied to.
struct RetainedModels {
  std::function<std::vector<KeptVersion>()> list;  // newest first
  // Refuses a version that an alias has come to name in between.
  std::function<absl::Status(const std::string& version)> remove;
};

// Applies a policy. Never removes a job that has not ended, nor its checkpoints.
class Retention {
 public:
  // What is referred to must outlive this.
  Retention(const RetentionPolicy& policy, Supervisor& jobs, RetainedModels models);
  ~Retention();
  Retention(const Retention&) = delete;
  Retention& operator=(const Retention&) = delete;

  // Removes what is too old. The first error, after all was tried.
  absl::Status Sweep(absl::Time now);

  // Something else that is to be done at each sweep. Before SweepRegularly.
  void AlsoSweep(std::function<absl::Status()> sweep) { others_.push_back(std::move(sweep)); }

  // Sweeps now and then once in every `interval`, on a thread of its own, until this is destroyed.
  void SweepRegularly(absl::Duration interval);

 private:
  absl::Status SweepJobs(absl::Time now);
  absl::Status SweepVersions();

  const RetentionPolicy policy_;
  Supervisor& jobs_;
  const RetainedModels models_;
  std::vector<std::function<absl::Status()>> others_;

  std::mutex mutex_;
  std::condition_variable changed_;
  bool ends_ = false;  // guarded by mutex_
  std::thread thread_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_RETENTION_H_
