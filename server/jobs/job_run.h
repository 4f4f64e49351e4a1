// One process of a job from its start to its end: its folder, its trainer, and what came of it.

#ifndef MANEUVER_SERVER_JOBS_JOB_RUN_H_
#define MANEUVER_SERVER_JOBS_JOB_RUN_H_

#include <filesystem>
#include <functional>

#include "absl/time/time.h"
#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/child_process.h"
#include "server/jobs/job_environment.h"
#include "server/jobs/progress_recorder.h"

namespace maneuver::jobs {

// Counts a process of the job that is to start now.
void BeginAttempt(v1::Job& job, const std::filesystem::path& folder, absl::Time now);
// Counts the end of that process, at `end`.
//   died: it is to be held against the job if it left no new checkpoint.
void EndAttempt(v1::Job& job, const std::filesystem::path& folder, absl::Time end, bool died);

// Runs one attempt at `job`, which BeginAttempt counted, in `folder`: the process that trains,
// evaluates or cross-validates, and those that measure what is to be promoted, each only if it is
// yet to be done. Returns the job with all that goes with its new state but its end_time: in one of
// the states that end it, or PENDING if another process is to go on. Writes in `folder`:
//   settings.json   what the trainer is told
//   trainer.log     the trainer's standard error
//   checkpoints     where the next process resumes; removed once the job has SUCCEEDED
//   output          the trainer's result, until it is published or read; of a cross-validation,
//                   the report and the models
//   promotion       the same files of the evaluations that decide about promotion, and
//                   decision.json once the decision is to be carried out
v1::Job RunJob(v1::Job job, const std::filesystem::path& folder,
               const JobRunEnvironment& environment, StopRequest& stop, ProgressRecorder& progress,
               const std::function<absl::Time()>& now);

// Removes from a job's folder what its trainer made but nobody wants.
void RemoveJobOutput(const std::filesystem::path& folder);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_RUN_H_
