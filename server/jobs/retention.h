// What is kept of jobs and models, and for how long.

#ifndef MANEUVER_SERVER_JOBS_RETENTION_H_
#define MANEUVER_SERVER_JOBS_RETENTION_H_

#include <condition_variable>
#include <functional>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "server/jobs/supervisor.h"
#include "server/serving/model_versions.h"

namespace maneuver::jobs {

struct RetentionPolicy {
  // Jobs are forgotten so long after their end; infinite: never. What they made stays.
  absl::Duration jobs = absl::Hours(24 * 90);
  // Checkpoints of jobs that failed or were cancelled are removed so long after their end.
  absl::Duration checkpoints = absl::Hours(24 * 14);
  // Of each model the newest so many versions stay, and all that an alias names; 0: all of them.
  int versions = 0;
};

// Returns the versions that the policy gives up.
//   versions: newest first.
//   needed: names of the versions that pending and running jobs read.
std::vector<security::ModelVersionName> VersionsToDelete(
    const RetentionPolicy& policy,
    const std::vector<serving::ModelVersions::ListedVersion>& versions,
    const std::set<std::string>& needed);

// Applies a policy. Never removes a job that has not ended, nor its checkpoints.
class Retention {
 public:
  // `jobs` and `versions` outlive this.
  Retention(const RetentionPolicy& policy, Supervisor& jobs, serving::ModelVersions& versions);
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
  serving::ModelVersions& versions_;
  std::vector<std::function<absl::Status()>> others_;

  std::mutex mutex_;
  std::condition_variable changed_;
  bool ends_ = false;  // guarded by mutex_
  std::thread thread_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_RETENTION_H_
