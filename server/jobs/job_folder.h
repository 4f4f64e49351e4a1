// The folder that an attempt at a job works in. If one server uses the folder of jobs alone, every
// attempt works in the job's own folder. Once several servers have shared the folder of jobs, each
// attempt has a folder of its own, attempts/FENCE in the job's folder (FENCE as in JobLease).
// The folder contains
//
//   settings.json   the settings that the trainer reads (job_settings.h)
//   trainer.log     the trainer's standard error
//   checkpoints     where the next process resumes (checkpoints.h); removed once the job has
//                   SUCCEEDED
//   output          the trainer's result, until it is published or read. A cross-validation has its
//                   report and its models here
//   promotion       the same files for the evaluations that decide about promotion, and
//                   decision.json, the last decision that was to be carried out

#ifndef MANEUVER_SERVER_JOBS_JOB_FOLDER_H_
#define MANEUVER_SERVER_JOBS_JOB_FOLDER_H_

#include <cstdint>
#include <filesystem>

#include "absl/status/statusor.h"

namespace maneuver::jobs {

// In the folder of an attempt, and in its promotion folder.
inline constexpr char kSettingsFile[] = "settings.json";
inline constexpr char kLogFile[] = "trainer.log";
inline constexpr char kOutput[] = "output";
// In the folder of an attempt.
inline constexpr char kPromotionFolder[] = "promotion";
inline constexpr char kDecisionFile[] = "decision.json";  // in the promotion folder

// Returns the folder of the latest attempt at the job in `job_folder`.
std::filesystem::path LatestAttemptFolder(const std::filesystem::path& job_folder);

// Makes the folder of a new attempt, and gives it the settings, checkpoints and decision of the
// latest attempt, whose worker may still be writing in its own folder. Removes the folders of
// earlier attempts, and the checkpoints in the job's own folder. Errors: of files, with the reason
// CANNOT_WRITE or DISK_FULL.
absl::StatusOr<std::filesystem::path> MakeAttemptFolder(const std::filesystem::path& job_folder,
                                                        int64_t fence);

// Removes the trainer's output and what was half-written from the folder of an attempt and from its
// promotion folder.
void RemoveJobOutput(const std::filesystem::path& folder);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_FOLDER_H_
