// One step of a job. A job is a list of steps that run in order: see job_steps.h.

#ifndef MANEUVER_SERVER_JOBS_JOB_STEP_H_
#define MANEUVER_SERVER_JOBS_JOB_STEP_H_

#include "absl/status/status.h"
#include "server/jobs/job_attempt.h"

namespace maneuver::jobs {

class JobStep {
 public:
  virtual ~JobStep() = default;

  // Records in the job what an earlier process made but did not record before it died. Called
  // before IsDone when a job resumes. An error ends the job.
  virtual absl::Status Recall() { return absl::OkStatus(); }
  // Returns whether the result of this step exists, in the job or in its folder. A job that resumes
  // after a crash continues at the first step that is not done.
  virtual bool IsDone() const = 0;
  // Returns whether the step may be left to a later process. Such a step does not begin once the
  // job is asked to stop or too many of its processes have died. Must be true of every step that
  // may start a process.
  virtual bool CanWait() const { return true; }
  // Does the step and records its result in the job. Later steps run if the outcome is OK.
  virtual Outcome Run() = 0;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_STEP_H_
