// The files of a version as they travel between servers: model.json and weights.safetensors, and
// baselines.json and baselines.safetensors where it has trained baselines. What else its folder
// holds (who made it, what it was evaluated on) speaks of its own server.

#ifndef MANEUVER_SERVER_SERVING_VERSION_FILES_H_
#define MANEUVER_SERVER_SERVING_VERSION_FILES_H_

#include <google/protobuf/repeated_field.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/model_service.pb.h"
#include "model/scene/field_violation.h"
#include "server/serving/model_registry.h"

namespace maneuver::serving {

// The largest files that are taken.
inline constexpr int64_t kMaxManifestBytes = int64_t{16} << 20;  // .json
inline constexpr int64_t kMaxWeightsBytes = int64_t{2} << 30;    // .safetensors

inline constexpr char kManifestFile[] = "model.json";
inline constexpr char kWeightsFile[] = "weights.safetensors";
inline constexpr char kBaselinesManifestFile[] = "baselines.json";
inline constexpr char kBaselinesWeightsFile[] = "baselines.safetensors";

// What is wrong with the files that a sender announces: the first two are there, the others both or
// not at all, each once, with a size within its limit and a SHA-256. Paths are as in
// "files[0].file".
std::vector<scene::FieldViolation> ValidateVersionFiles(
    const google::protobuf::RepeatedPtrField<v1::ModelFile>& files);

// One version, read from its first byte to its last. It stays what it was when it was opened, also
// if an action gets a label, or the version is deleted, meanwhile. Not thread-safe.
class VersionReader {
 public:
  // Errors: FAILED_PRECONDITION if the version is damaged.
  static absl::StatusOr<std::unique_ptr<VersionReader>> Open(
      const ModelRegistry::ResolvedVersion& version);
  virtual ~VersionReader() = default;

  virtual const v1::DownloadModelHeader& header() const = 0;
  // Leaves out the first bytes of each file. INVALID_ARGUMENT, with the field arrived_bytes, unless
  // there is a number for each file that fits its size, or none at all. Call before Next.
  virtual absl::Status Skip(const google::protobuf::RepeatedField<int64_t>& arrived_bytes) = 0;
  // The next bytes, at most 1 MiB, of one file; empty at the end.
  virtual absl::StatusOr<std::string> Next() = 0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_VERSION_FILES_H_
