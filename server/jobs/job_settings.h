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

// Resolves the settings of a job, fills in every unset field, and writes them as settings.json into
// its folder. Keeps an existing file: a later release with other presets resumes the job with the
// settings of its admission. The trainer checks the settings.
//   job: its start_from must be resolved.
// Errors: those of ModelVersions::Resolve and of reading the manifest of start_from; those of
// files.
absl::Status EnsureSettings(const v1::Job& job, const serving::ModelVersions& versions,
                            const std::filesystem::path& folder);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_SETTINGS_H_
