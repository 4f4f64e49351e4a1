// A model version on disk: a folder with weights.safetensors and model.json, which carries its own
// digest (files/sealed_json.h) and that of the weights.

#ifndef MANEUVER_MODEL_ARTIFACT_MODEL_FOLDER_H_
#define MANEUVER_MODEL_ARTIFACT_MODEL_FOLDER_H_

#include <filesystem>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/model.pb.h"
#include "model/artifact/tensor.h"

namespace maneuver::artifact {

struct StoredModel {
  v1::ModelManifest manifest;
  TensorMap weights;
};

// Writes `folder` completely or not at all: writes a temporary folder beside it, syncs it and
// renames it. Fills in manifest.weights_sha256 and format_version. The manifest's actions are all K
// in order, or none yet; their display names are not stored. ALREADY_EXISTS if `folder` exists;
// INVALID_ARGUMENT for a model that ReadModelFolder would refuse; errors of files.
absl::Status WriteModelFolder(const std::filesystem::path& folder, StoredModel model);

// Reads the manifest alone and does not check the weights. NOT_FOUND if there is no such folder;
// DATA_LOSS with the reason if any byte of the manifest is damaged. A manifest of an older release
// carries no digest, and damage may go unnoticed.
absl::StatusOr<v1::ModelManifest> ReadModelManifest(const std::filesystem::path& folder);

// Returns whether model.json carries its digest. A rewritten manifest always does.
bool HasManifestDigest(const std::filesystem::path& folder);

// Reads manifest and weights. NOT_FOUND if there is no such folder; DATA_LOSS with the reason if a
// file is truncated or altered (SHA-256), or a tensor is missing, has another shape than the spec
// says, or contains a value that is not finite.
absl::StatusOr<StoredModel> ReadModelFolder(const std::filesystem::path& folder);

// Replaces model.json alone, atomically (actions and their labels, metrics). INVALID_ARGUMENT
// unless `manifest` is valid and was read from this folder: spec and SHA-256 go with the weights.
// Other errors: those of ReadModelManifest, and of files.
absl::Status RewriteModelManifest(const std::filesystem::path& folder,
                                  const v1::ModelManifest& manifest);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_MODEL_FOLDER_H_
