// How the progress of a job that decides about promotion is divided among its steps.

#ifndef MANEUVER_SERVER_JOBS_JOB_PROGRESS_PARTS_H_
#define MANEUVER_SERVER_JOBS_JOB_PROGRESS_PARTS_H_

namespace maneuver::jobs {

// The progress of the job, from 0 to 1, once the model is trained, and once the new version is
// measured.
inline constexpr double kTrainedAt = 0.9;
inline constexpr double kMeasuredAt = 0.95;

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_PROGRESS_PARTS_H_
