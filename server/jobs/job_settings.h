// The settings of a job, resolved once: when the job is admitted.

#ifndef MANEUVER_SERVER_JOBS_JOB_SETTINGS_H_
#define MANEUVER_SERVER_JOBS_JOB_SETTINGS_H_

#include <google/protobuf/message.h>

#include <filesystem>

#include "absl/status/status.h"
#include "maneuver/v1/training_service.pb.h"
#include "server/serving/model_versions.h"

namespace maneuver::jobs {

// Writes settings.json in `folder`, which is created if it is missing.
absl::Status WriteSettings(const google::protobuf::Message& settings,
                           const std::filesystem::path& folder);

// Resolves the settings of a job, every unset field filled in, and writes them as settings.json in
// its folder. Keeps a file that is there: a later release, with other presets, resumes the job with
// the settings that it was admitted with. The trainer checks them.
//   job: its start_from is resolved already.
// Errors: those of ModelVersions::Resolve and of reading the manifest of start_from; those of files.
absl::Status EnsureSettings(const v1::Job& job, const serving::ModelVersions& versions,
                            const std::filesystem::path& folder);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_SETTINGS_H_
