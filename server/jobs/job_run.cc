#include "server/jobs/job_run.h"

#include <algorithm>
#include <utility>

#include "server/errors/error_details.h"
#include "server/jobs/checkpoints.h"
#include "server/jobs/job_folder.h"
#include "server/jobs/job_promotion.h"
#include "server/jobs/job_steps.h"
#include "server/jobs/trainer_outcome.h"

namespace maneuver::jobs {
namespace {

bool AllDone(const JobSteps& steps) {
  return std::ranges::all_of(steps, [](const auto& step) { return step->IsDone(); });
}

// Runs the steps that are not done, until one fails or has to wait.
Outcome RunSteps(const v1::Job& job, const JobSteps& steps, const JobAttempt& attempt) {
  // Only an earlier attempt can have made something that the job does not tell.
  if (job.attempts().started() > 1) {
    for (const auto& step : steps) {
      if (absl::Status status = step->Recall(); !status.ok()) return {std::move(status)};
    }
  }
  const int most = attempt.environment.limits.attempts_without_progress;
  Outcome outcome;
  for (const auto& step : steps) {
    if (step->IsDone()) continue;
    if (step->CanWait() && job.attempts().without_progress() >= most) {
      return {GaveUp(errors::FromProto(job.error()), most)};
    }
    if (step->CanWait() && attempt.IsStopped()) break;
    outcome = step->Run();
    if (!outcome.status.ok()) break;
  }
  return outcome;
}

// Whether the job made a version, and has not decided yet whether that serves.
bool IsUndecided(const v1::Job& job) {
  return !job.model_version().empty() && !job.has_promotion_decision();
}

}  // namespace

v1::Job RunJob(v1::Job job, const std::filesystem::path& folder, const JobAttempt& attempt) {
  const int most = attempt.environment.limits.attempts_without_progress;
  const JobSteps steps = StepsOf(job, folder, attempt);
  Outcome outcome = RunSteps(job, steps, attempt);
  RemoveJobOutput(folder);
  const StopRequest::Reason stopped = attempt.stop.reason();
  EndAttempt(job, folder, attempt.now(), outcome.died && stopped == StopRequest::Reason::kNone);
  job.clear_error();
  // What cannot be written down now is made and done by the next attempt.
  const bool goes_on = errors::IsStoreAway(outcome.status) ||
                       (outcome.died && job.attempts().without_progress() < most);
  if (outcome.died && !goes_on) outcome.status = GaveUp(std::move(outcome.status), most);
  // The version is there and stays, whatever becomes of the decision. A stop of the server and the
  // death of a process put the decision off.
  if (IsUndecided(job) && stopped == StopRequest::Reason::kCancelled) {
    DecideAgainstPromotion(job, absl::CancelledError("the job was cancelled"), attempt.now());
  } else if (IsUndecided(job) && !attempt.IsPutOff() && !goes_on) {
    DecideAgainstPromotion(job, outcome.status, attempt.now());
  }
  // A job that is asked to stop too late has its result all the same.
  if (AllDone(steps)) {
    job.set_state(v1::JOB_STATE_SUCCEEDED);
    RemoveCheckpoints(folder);
  } else if (stopped == StopRequest::Reason::kCancelled) {
    job.set_state(v1::JOB_STATE_CANCELLED);
  } else if (attempt.IsPutOff()) {
    job.set_state(v1::JOB_STATE_PENDING);
    *job.mutable_error() = errors::ToProto(ServerInterrupted());
  } else if (goes_on) {
    job.set_state(v1::JOB_STATE_PENDING);
    *job.mutable_error() = errors::ToProto(outcome.status);
  } else {
    job.set_state(v1::JOB_STATE_FAILED);
    *job.mutable_error() = errors::ToProto(outcome.status);
  }
  if (!job.has_error()) job.clear_last_lines();
  return job;
}

}  // namespace maneuver::jobs
