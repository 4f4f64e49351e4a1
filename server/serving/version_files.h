// The files of a version that are copied between servers: model.json, weights.safetensors and, if
// it has trained baselines, baselines.json and baselines.safetensors. Other files of its folder,
// such as who made it and its evaluations, concern only its own server.

#ifndef MANEUVER_SERVER_SERVING_VERSION_FILES_H_
#define MANEUVER_SERVER_SERVING_VERSION_FILES_H_

#include <google/protobuf/repeated_field.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/model_service.pb.h"
#include "model/scene/field_violation.h"
#include "server/security/resource_name.h"

namespace maneuver::serving {

// The largest files that are accepted.
inline constexpr int64_t kMaxManifestBytes = int64_t{16} << 20;  // .json
inline constexpr int64_t kMaxWeightsBytes = int64_t{2} << 30;    // .safetensors

inline constexpr char kManifestFile[] = "model.json";
inline constexpr char kWeightsFile[] = "weights.safetensors";
inline constexpr char kBaselinesManifestFile[] = "baselines.json";
inline constexpr char kBaselinesWeightsFile[] = "baselines.safetensors";

// Returns what is wrong with the files that a sender announces. The manifest and weights are
// required; the two baseline files come together or not at all. Each file appears once, with a size
// within its limit and a SHA-256. Paths are as in "files[0].file".
std::vector<scene::FieldViolation> ValidateVersionFiles(
    const google::protobuf::RepeatedPtrField<v1::ModelFile>& files);

// Reads the files of one version from the first byte to the last. It keeps the state at opening,
// even if an action is labelled or the version is deleted meanwhile. Not thread-safe.
class VersionReader {
 public:
  // Opens a version. FAILED_PRECONDITION, reason MODEL_DAMAGED, if model.json cannot be read or
  // parsed; NOT_FOUND, or another error of files, if another file cannot be read.
  static absl::StatusOr<std::unique_ptr<VersionReader>> Open(const security::ModelVersionName& name,
                                                             const std::filesystem::path& folder);
  virtual ~VersionReader() = default;

  virtual const v1::DownloadModelHeader& header() const = 0;
  // Skips the first arrived_bytes[i] bytes of each file i. Call before Next. INVALID_ARGUMENT, with
  // the field arrived_bytes, unless it is empty or has for each file a number from 0 to its size.
  virtual absl::Status Skip(const google::protobuf::RepeatedField<int64_t>& arrived_bytes) = 0;
  // Returns the next bytes, at most 1 MiB and of one file; empty at the end. FAILED_PRECONDITION,
  // reason MODEL_DAMAGED, if a file has become shorter; errors of files.
  virtual absl::StatusOr<std::string> Next() = 0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_VERSION_FILES_H_
