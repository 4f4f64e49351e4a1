// The folders that the trainer's command line names.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_NAMED_FOLDERS_H_
#define MANEUVER_SERVER_JOBS_TRAINER_NAMED_FOLDERS_H_

#include <filesystem>
#include <vector>

#include "absl/status/status.h"

namespace maneuver::trainer {

// Returns the status with the folder's name before its message: "town: there is no such model".
absl::Status OfFolder(const absl::Status& status, const std::filesystem::path& folder);

// Checks that each folder is a dataset, and none is named twice: its recordings would count twice.
// INVALID_ARGUMENT, or the error of data::ReadDatasetManifest, with the folder's name.
absl::Status CheckDatasets(const std::vector<std::filesystem::path>& folders);

// Makes sure that a file or folder can be written when there is something to write: makes the
// folders that it lies in, and an empty folder beside it for a moment. PERMISSION_DENIED, or
// RESOURCE_EXHAUSTED if the disk is full.
absl::Status PrepareOutput(const std::filesystem::path& output);

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_NAMED_FOLDERS_H_
