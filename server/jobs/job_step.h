// One step of a job. A job is a list of steps that run in order: see job_steps.h.

#ifndef MANEUVER_SERVER_JOBS_JOB_STEP_H_
#define MANEUVER_SERVER_JOBS_JOB_STEP_H_

#include "absl/status/status.h"
#include "server/jobs/job_attempt.h"

namespace maneuver::jobs {

class JobStep {
 public:
  virtual ~JobStep() = default;

  // Puts on the job what an earlier process of it made but did not live to tell. Called before
  // IsDone when a job resumes. An error ends the job.
  virtual absl::Status Recall() { return absl::OkStatus(); }
  // Whether the job, or its folder, has what this step makes. A job that resumes after a crash goes
  // on at the first step that is not done.
  virtual bool IsDone() const = 0;
  // Whether the step is left to a later process once the job is asked to stop, and is not begun
  // once too many processes of the job have died. True of every step that may start a process.
  virtual bool CanWait() const { return true; }
  // Does the step, and puts on the job what it made. Later steps run if the outcome is OK.
  virtual Outcome Run() = 0;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_STEP_H_
