// Reads the manifest of a dataset folder, and compares it with the files beside it.

#ifndef MANEUVER_MODEL_DATA_DATASET_FILES_H_
#define MANEUVER_MODEL_DATA_DATASET_FILES_H_

#include <filesystem>

#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"

namespace maneuver::data {

// Reads dataset.json and checks that the shards have the sizes that it states. If the folder was
// registered in place, also checks that they have not changed since (registered_folder.h).
// NOT_FOUND, or DATA_LOSS with the reason.
absl::StatusOr<v1::Dataset> ReadDatasetManifest(const std::filesystem::path& folder);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_DATASET_FILES_H_
