#ifndef MANEUVER_SERVER_JOBS_TRAINER_DATASET_NAMES_H_
#define MANEUVER_SERVER_JOBS_TRAINER_DATASET_NAMES_H_

#include <filesystem>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace maneuver::trainer {

// Returns the names of dataset folders: those that --dataset-name gave, or else the folders' own.
// INVALID_ARGUMENT if some folders have a name and others have none.
//   given: one for each folder, in their order, or empty
absl::StatusOr<std::vector<std::string>> DatasetNames(
    const std::vector<std::string>& given, const std::vector<std::filesystem::path>& folders);

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_DATASET_NAMES_H_
