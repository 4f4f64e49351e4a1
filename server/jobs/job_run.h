// Runs the steps of a job, and says what became of it.

#ifndef MANEUVER_SERVER_JOBS_JOB_RUN_H_
#define MANEUVER_SERVER_JOBS_JOB_RUN_H_

#include <filesystem>

#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/job_attempt.h"

namespace maneuver::jobs {

// Makes one attempt at `job`, which BeginAttempt has counted: runs its steps (job_steps.h) in
// `folder` (job_folder.h), from the first one that is not done. Returns the job with everything
// that goes with its new state but its end_time: in one of the states that end a job, or PENDING if
// another attempt is to go on.
v1::Job RunJob(v1::Job job, const std::filesystem::path& folder, const JobAttempt& attempt);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_RUN_H_
