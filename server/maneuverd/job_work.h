// What runs jobs, and tidies up after jobs and uploads.

#ifndef MANEUVER_SERVER_MANEUVERD_JOB_WORK_H_
#define MANEUVER_SERVER_MANEUVERD_JOB_WORK_H_

#include <chrono>
#include <memory>
#include <optional>

#include "absl/status/statusor.h"
#include "server/jobs/retention.h"
#include "server/jobs/supervisor.h"
#include "server/maneuverd/options.h"
#include "server/maneuverd/storage.h"
#include "server/monitoring/metrics.h"
#include "server/serving/local_model_versions.h"
#include "server/serving/version_uploads.h"

namespace maneuver {

// Returns how long a trainer may take to write its last checkpoint when the server ends.
std::chrono::milliseconds PatienceWithTrainers(const ServerOptions& options);

class JobWork {
 public:
  // Goes on with the jobs of the store, and sweeps away what is too old: now and once an hour.
  // Errors: those of Supervisor::Start. `storage` and `metrics` must outlive the result.
  static absl::StatusOr<std::unique_ptr<JobWork>> Start(const ServerOptions& options,
                                                        Storage& storage,
                                                        monitoring::MetricRegistry& metrics);

  jobs::Supervisor& supervisor() { return *supervisor_; }
  serving::VersionUploads& version_uploads() { return version_uploads_; }

 private:
  JobWork(const ServerOptions& options, Storage& storage);

  serving::LocalModelVersions versions_;
  serving::VersionUploads version_uploads_;
  std::unique_ptr<jobs::Supervisor> supervisor_;
  std::optional<jobs::Retention> retention_;  // last: ends before what it sweeps
};

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_JOB_WORK_H_
