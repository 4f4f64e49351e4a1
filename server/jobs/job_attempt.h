// One attempt at a job: from the moment when the server takes it up until its processes have ended.

#ifndef MANEUVER_SERVER_JOBS_JOB_ATTEMPT_H_
#define MANEUVER_SERVER_JOBS_JOB_ATTEMPT_H_

#include <filesystem>
#include <functional>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/child_process.h"
#include "server/jobs/job_environment.h"
#include "server/jobs/progress_recorder.h"

namespace maneuver::jobs {

// What all steps of an attempt share. What it refers to outlives it.
struct JobAttempt {
  const JobRunEnvironment& environment;
  StopRequest& stop;
  ProgressRecorder& progress;
  const std::function<absl::Time()>& now;

  // Whether somebody has asked the job to stop.
  bool IsStopped() const { return stop.reason() != StopRequest::Reason::kNone; }
};

// How a step of a job ended.
struct Outcome {
  absl::Status status;
  // Its process ended for no reason of its own: the job goes on with another one.
  bool died = false;
};

// Counts an attempt at the job that is about to start.
void BeginAttempt(v1::Job& job, const std::filesystem::path& folder, absl::Time now);
// Counts the end of that attempt, at `end`.
//   died: the attempt counts against the job if it left no new checkpoint.
void EndAttempt(v1::Job& job, const std::filesystem::path& folder, absl::Time end, bool died);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_ATTEMPT_H_
