// How a dataset folder is laid out; for the .cc files of this folder alone.

#ifndef MANEUVER_MODEL_DATA_DATASET_LAYOUT_H_
#define MANEUVER_MODEL_DATA_DATASET_LAYOUT_H_

#include <filesystem>

#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"

namespace maneuver::data {

inline constexpr char kManifestFile[] = "dataset.json";
inline constexpr int kDatasetFormatVersion = 1;

// dataset.json, valid in itself; the shards are not looked at.
absl::StatusOr<v1::Dataset> LoadDatasetManifest(const std::filesystem::path& folder);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_DATASET_LAYOUT_H_
