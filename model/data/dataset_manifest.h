// The manifest of a dataset folder, dataset.json.

#ifndef MANEUVER_MODEL_DATA_DATASET_MANIFEST_H_
#define MANEUVER_MODEL_DATA_DATASET_MANIFEST_H_

#include <filesystem>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"
#include "model/scene/field_violation.h"

namespace maneuver::data {

inline constexpr char kManifestFile[] = "dataset.json";
inline constexpr int kDatasetFormatVersion = 1;
inline constexpr size_t kMaxOrigin = 1000;  // bytes of Dataset.origin

// Checks a manifest without reading any other file, and returns its first 16 faults. File names
// must be as the comment of Shard.file demands, occur once and contain no folder. Sizes and digests
// must be valid, and totals must match. Field paths start at the manifest: shards[0].file, ...
std::vector<scene::FieldViolation> ValidateDatasetManifest(const v1::Dataset& manifest);

// Convert a manifest from and to JSON. dataset.json also contains a digest of this JSON. Parsing
// ignores fields that it does not know; DATA_LOSS for anything else that is not a manifest.
absl::StatusOr<v1::Dataset> ParseDatasetManifest(const std::string& json);
std::string PrintDatasetManifest(const v1::Dataset& manifest);

// Returns one digest over all contents of a dataset: EvaluationReport.dataset_sha256.
std::string ContentSha256(const v1::Dataset& manifest);

// Reads dataset.json and checks it by itself, without the shards. NOT_FOUND if it is missing;
// DATA_LOSS if it has a fault, or its content is damaged (files/sealed_json.h). A file from an
// older release or another tool has no digest, so damage to it may go unnoticed.
absl::StatusOr<v1::Dataset> LoadDatasetManifest(const std::filesystem::path& folder);
// Writes dataset.json, with its digest, in one step.
absl::Status WriteDatasetManifest(const std::filesystem::path& folder, const v1::Dataset& manifest);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_DATASET_MANIFEST_H_
