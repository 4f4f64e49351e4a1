// The steps of each kind of job:
//
//   training           Learn → Publish → Measure → Decide
//   evaluation         Evaluate
//   cross-validation   CrossValidate
//   recalibration      Recalibrate → Publish → Measure → Decide
//   tagging            Tag

#ifndef MANEUVER_SERVER_JOBS_JOB_STEPS_H_
#define MANEUVER_SERVER_JOBS_JOB_STEPS_H_

#include <filesystem>
#include <memory>
#include <vector>

#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/job_attempt.h"
#include "server/jobs/job_step.h"

namespace maneuver::jobs {

// In the order in which they run.
using JobSteps = std::vector<std::unique_ptr<JobStep>>;

// Returns the steps of a job with this folder. `job` and `attempt` must outlive them.
JobSteps StepsOf(v1::Job& job, const std::filesystem::path& folder, const JobAttempt& attempt);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_STEPS_H_
