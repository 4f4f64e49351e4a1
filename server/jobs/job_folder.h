// What the folder of a job holds:
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

#include <filesystem>

namespace maneuver::jobs {

// In a job's folder and in its promotion folder.
inline constexpr char kSettingsFile[] = "settings.json";
inline constexpr char kLogFile[] = "trainer.log";
inline constexpr char kOutput[] = "output";
// In a job's folder.
inline constexpr char kPromotionFolder[] = "promotion";

// Removes from a job's folder the results of its trainer that nobody needs any more.
void RemoveJobOutput(const std::filesystem::path& folder);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_FOLDER_H_
