#include "server/jobs/job_attempt.h"

#include <algorithm>

#include "server/jobs/checkpoints.h"
#include "server/jobs/job_time.h"

namespace maneuver::jobs {

void BeginAttempt(v1::Job& job, const std::filesystem::path& folder, absl::Time now) {
  v1::JobAttempts& attempts = *job.mutable_attempts();
  attempts.set_started(attempts.started() + 1);
  *attempts.mutable_start_time() = ToTimestamp(now);
  attempts.set_checkpoint(LastCheckpoint(folder));
  if (!job.has_start_time()) *job.mutable_start_time() = ToTimestamp(now);
}

void EndAttempt(v1::Job& job, const std::filesystem::path& folder, absl::Time end, bool died) {
  v1::JobAttempts& attempts = *job.mutable_attempts();
  const absl::Duration ran = std::max(absl::ZeroDuration(), end - ToTime(attempts.start_time()));
  *attempts.mutable_earlier_run_time() = ToProto(ToDuration(attempts.earlier_run_time()) + ran);
  if (LastCheckpoint(folder) > attempts.checkpoint()) {
    attempts.set_without_progress(0);
  } else if (died) {
    attempts.set_without_progress(attempts.without_progress() + 1);
  }
}

}  // namespace maneuver::jobs
