// What the folder of an attempt at a job holds. All attempts of a server that is alone have the
// folder of the job. Once several servers have shared the folder of jobs, attempt FENCE (JobLease)
// has attempts/FENCE in it, and the job's own folder has the settings.
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

// In a job's folder and in its promotion folder.
inline constexpr char kSettingsFile[] = "settings.json";
inline constexpr char kLogFile[] = "trainer.log";
inline constexpr char kOutput[] = "output";
// In a job's folder.
inline constexpr char kPromotionFolder[] = "promotion";
inline constexpr char kDecisionFile[] = "decision.json";  // in it

// Returns the folder of the latest attempt at the job in `job_folder`.
std::filesystem::path LatestAttemptFolder(const std::filesystem::path& job_folder);

// Makes a folder for a new attempt: with settings, checkpoints and decision of the latest one, whose
// worker may still write in its own folder. Removes the folders of earlier attempts. Errors: of
// files, with the reason CANNOT_WRITE or DISK_FULL.
absl::StatusOr<std::filesystem::path> MakeAttemptFolder(const std::filesystem::path& job_folder,
                                                        int64_t fence);

// Removes from a job's folder the results of its trainer that nobody needs any more.
void RemoveJobOutput(const std::filesystem::path& folder);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_FOLDER_H_
