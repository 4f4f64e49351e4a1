// Decides which jobs, checkpoints and versions are kept, and for how long.

#ifndef MANEUVER_SERVER_JOBS_RETENTION_H_
#define MANEUVER_SERVER_JOBS_RETENTION_H_

#include <functional>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "locks/stop_latch.h"
#include "server/jobs/supervisor.h"
#include "server/serving/model_versions.h"

namespace maneuver::jobs {

struct RetentionPolicy {
  // How long after its end a job is removed; infinite: never. The versions that it made stay.
  absl::Duration jobs = absl::Hours(24 * 90);
  // How long after their end the checkpoints of jobs that failed or were cancelled are removed.
  absl::Duration checkpoints = absl::Hours(24 * 14);
  // How many of the newest versions of each model stay, besides those that an alias points to; 0:
  // all.
  int versions = 0;
};

// Returns the versions that the policy deletes.
//   needed: names of the pending and running jobs, and of the versions that they read. What such a
//     job has made stays: the job may still measure it.
std::vector<security::ModelVersionName> VersionsToDelete(
    const RetentionPolicy& policy,
    const std::vector<serving::ModelVersions::ListedVersion>& versions,
    const std::set<std::string>& needed);

// Applies a policy. Never removes a job that has not ended, nor its checkpoints.
class Retention {
 public:
  // `jobs` and `versions` must outlive this object.
  Retention(const RetentionPolicy& policy, Supervisor& jobs, serving::ModelVersions& versions);
  ~Retention();
  Retention(const Retention&) = delete;
  Retention& operator=(const Retention&) = delete;

  // Removes everything that is too old. Continues after an error, and returns the first one.
  absl::Status Sweep(absl::Time now);

  // Makes each sweep also call `sweep`. Call before SweepRegularly.
  void AlsoSweep(std::function<absl::Status()> sweep) { others_.push_back(std::move(sweep)); }

  // Sweeps at once and then once every `interval`, on its own thread, until it is destroyed.
  void SweepRegularly(absl::Duration interval);

 private:
  absl::Status SweepJobs(absl::Time now);
  absl::Status SweepVersions();

  const RetentionPolicy policy_;
  Supervisor& jobs_;
  serving::ModelVersions& versions_;
  std::vector<std::function<absl::Status()>> others_;

  StopLatch stop_;
  std::thread thread_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_RETENTION_H_
