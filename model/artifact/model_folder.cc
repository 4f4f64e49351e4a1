#include "model/artifact/model_folder.h"

#include <google/protobuf/util/json_util.h>
#include <google/protobuf/util/message_differencer.h>

#include <string>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_spec.h"
#include "model/artifact/model_weights.h"
#include "model/artifact/safetensors.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "model/files/sealed_json.h"

namespace maneuver::artifact {

using google::protobuf::util::MessageDifferencer;
namespace {

namespace fs = std::filesystem;

constexpr int kFormatVersion = 1;
constexpr char kManifestFile[] = "model.json";
constexpr char kWeightsFile[] = "weights.safetensors";

// Returns the first fault of a manifest; empty if there is none.
std::string FindManifestFault(const v1::ModelManifest& manifest) {
  const auto violations = ValidateModelSpec(manifest.spec());
  if (!violations.empty()) {
    return absl::StrCat("spec.", violations[0].field, ": ", violations[0].description);
  }
  // A model gets its action set when it is decoded from disk; until then it has none.
  if (manifest.actions_size() != 0 && manifest.actions_size() != manifest.spec().actions()) {
    return absl::StrCat("has ", manifest.actions_size(), " actions, its spec says ",
                        manifest.spec().actions());
  }
  for (int i = 0; i < manifest.actions_size(); ++i) {
    if (manifest.actions(i).action_id() != i)
      return absl::StrCat("actions[", i, "] is not in order");
  }
  return "";
}

absl::StatusOr<std::string> ManifestToJson(v1::ModelManifest manifest) {
  for (v1::Action& action : *manifest.mutable_actions()) action.clear_display_name();
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  options.preserve_proto_field_names = true;
  std::string json;
  const auto status = google::protobuf::util::MessageToJsonString(manifest, &json, options);
  if (!status.ok()) {
    return absl::InternalError(
        absl::StrCat("cannot write the manifest as JSON: ", std::string(status.message())));
  }
  return files::Seal(json);
}

// A missing file in an existing folder is damage, not absence. A file system that fails says of no
// folder that it is missing.
absl::StatusOr<std::string> ReadPart(const fs::path& folder, const char* file) {
  absl::StatusOr<std::string> content = files::ReadFile(folder / file);
  if (!absl::IsNotFound(content.status())) return content;
  std::error_code ignored;
  if (!fs::is_directory(folder, ignored)) return absl::NotFoundError("there is no such model");
  return absl::DataLossError(absl::StrCat(file, " is missing"));
}

absl::Status WriteParts(const fs::path& folder, const std::string& json,
                        const std::string& weights) {
  if (auto status = files::WriteFileAtomically(folder / kWeightsFile, weights); !status.ok()) {
    return status;
  }
  return files::WriteFileAtomically(folder / kManifestFile, json);
}

}  // namespace

absl::Status WriteModelFolder(const fs::path& folder, StoredModel model) {
  const std::string manifest_fault = FindManifestFault(model.manifest);
  if (!manifest_fault.empty()) return absl::InvalidArgumentError(manifest_fault);
  const std::string fault = FindWeightFault(model.manifest.spec(), model.weights);
  if (!fault.empty()) return absl::InvalidArgumentError(fault);

  const std::string weights = SerializeSafetensors(model.weights);
  model.manifest.set_format_version(kFormatVersion);
  model.manifest.set_weights_sha256(files::Sha256Hex(weights));
  const absl::StatusOr<std::string> json = ManifestToJson(model.manifest);
  if (!json.ok()) return json.status();

  const absl::StatusOr<fs::path> temporary = files::MakeTemporaryFolderFor(folder);
  if (!temporary.ok()) return temporary.status();
  absl::Status status = WriteParts(*temporary, *json, weights);
  if (status.ok()) status = files::PublishFolder(*temporary, folder);
  if (!status.ok()) {
    std::error_code ignored;
    fs::remove_all(*temporary, ignored);
  }
  return status;
}

bool HasManifestDigest(const fs::path& folder) {
  return files::IsSealed(files::ReadFile(folder / kManifestFile).value_or(""));
}

absl::StatusOr<v1::ModelManifest> ReadModelManifest(const fs::path& folder) {
  const absl::StatusOr<std::string> text = ReadPart(folder, kManifestFile);
  if (!text.ok()) return text.status();
  const absl::StatusOr<std::string> json = files::Unseal(*text);
  if (!json.ok()) {
    return absl::DataLossError(absl::StrCat(kManifestFile, " ", json.status().message()));
  }
  v1::ModelManifest manifest;
  const auto status = google::protobuf::util::JsonStringToMessage(*json, &manifest);
  if (!status.ok()) {
    return absl::DataLossError(
        absl::StrCat(kManifestFile, " does not parse: ", std::string(status.message())));
  }
  if (manifest.format_version() != kFormatVersion) {
    return absl::DataLossError(absl::StrCat(kManifestFile, " has format version ",
                                            manifest.format_version(), ", this reads version ",
                                            kFormatVersion));
  }
  const std::string fault = FindManifestFault(manifest);
  if (!fault.empty()) return absl::DataLossError(absl::StrCat(kManifestFile, ": ", fault));
  return manifest;
}

absl::StatusOr<StoredModel> ReadModelFolder(const fs::path& folder) {
  absl::StatusOr<v1::ModelManifest> manifest = ReadModelManifest(folder);
  if (!manifest.ok()) return manifest.status();
  const absl::StatusOr<std::string> bytes = ReadPart(folder, kWeightsFile);
  if (!bytes.ok()) return bytes.status();
  const std::string sha256 = files::Sha256Hex(*bytes);
  if (sha256 != manifest->weights_sha256()) {
    return absl::DataLossError(absl::StrCat(
        kWeightsFile, " (", bytes->size(), " bytes) is truncated or altered: its SHA-256 is ",
        sha256, ", ", kManifestFile, " says ", manifest->weights_sha256()));
  }
  absl::StatusOr<TensorMap> weights = ParseSafetensors(*bytes);
  if (!weights.ok()) {
    return absl::DataLossError(absl::StrCat(kWeightsFile, ": ", weights.status().message()));
  }
  const std::string fault = FindWeightFault(manifest->spec(), *weights);
  if (!fault.empty()) return absl::DataLossError(absl::StrCat(kWeightsFile, ": ", fault));
  return StoredModel{*std::move(manifest), *std::move(weights)};
}

absl::Status RewriteModelManifest(const fs::path& folder, const v1::ModelManifest& manifest) {
  const std::string fault = FindManifestFault(manifest);
  if (!fault.empty()) return absl::InvalidArgumentError(fault);
  const absl::StatusOr<v1::ModelManifest> current = ReadModelManifest(folder);
  if (!current.ok()) return current.status();
  if (manifest.format_version() != current->format_version() ||
      manifest.weights_sha256() != current->weights_sha256() ||
      !MessageDifferencer::Equals(manifest.spec(), current->spec())) {
    return absl::InvalidArgumentError("the manifest is not that of the weights in the folder");
  }
  const absl::StatusOr<std::string> json = ManifestToJson(manifest);
  if (!json.ok()) return json.status();
  return files::WriteFileAtomically(folder / kManifestFile, *json);
}

}  // namespace maneuver::artifact
