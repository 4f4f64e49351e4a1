// Runs the steps of a job, and records their result in the job.

#ifndef MANEUVER_SERVER_JOBS_JOB_RUN_H_
#define MANEUVER_SERVER_JOBS_JOB_RUN_H_

#include <filesystem>

#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/job_attempt.h"

namespace maneuver::jobs {

// Makes one attempt at `job`, which BeginAttempt has recorded: runs its steps (job_steps.h) in
// `folder` (job_folder.h), from the first one that is not done. Returns the job in its new state,
// without an end_time. The job has ended, or is PENDING if another attempt should follow.
v1::Job RunJob(v1::Job job, const std::filesystem::path& folder, const JobAttempt& attempt);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_RUN_H_
