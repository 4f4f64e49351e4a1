// One attempt at a job: from the moment when the server starts it until its processes have ended.

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
#include "server/serving/maker.h"

namespace maneuver::jobs {

// What all steps of an attempt share. Everything that it refers to must outlive it.
struct JobAttempt {
  const JobRunEnvironment& environment;
  StopRequest& stop;
  ProgressRecorder& progress;
  const std::function<absl::Time()>& now;
  const serving::Maker maker;  // the job, with the fence of this attempt

  // Returns whether the job was asked to stop.
  bool IsStopped() const { return stop.reason() != StopRequest::Reason::kNone; }
  // Returns whether it was asked to stop so that a later attempt goes on with it.
  bool IsPutOff() const {
    return stop.reason() == StopRequest::Reason::kServerStops ||
           stop.reason() == StopRequest::Reason::kLeaseLost;
  }
};

// How a step of a job ended.
struct Outcome {
  absl::Status status;
  // The step's process crashed, or something other than this server killed it. Another process can
  // continue the job.
  bool died = false;
};

// Records the start of an attempt in the job.
//   folder: the job's folder
void BeginAttempt(v1::Job& job, const std::filesystem::path& folder, absl::Time now);
// Records in the job that this attempt ended at `end`.
//   died: Outcome::died. If true, the attempt counts as failed, unless it left a new checkpoint.
void EndAttempt(v1::Job& job, const std::filesystem::path& folder, absl::Time end, bool died);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_ATTEMPT_H_
