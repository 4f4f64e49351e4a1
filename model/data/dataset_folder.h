// A dataset on disk: TFRecord shards and dataset.json.

#ifndef MANEUVER_MODEL_DATA_DATASET_FOLDER_H_
#define MANEUVER_MODEL_DATA_DATASET_FOLDER_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"
#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/scene/field_violation.h"

namespace maneuver::data {

struct DatasetWriterOptions {
  // A shard that has reached this size is followed by a new one.
  int64_t shard_bytes = int64_t{64} << 20;
};

// Writes a new dataset folder, whole or not at all: shards go to a temporary folder beside it,
// which Commit syncs and renames. Not thread-safe.
class DatasetWriter {
 public:
  // ALREADY_EXISTS if `folder` exists. `origin` becomes Dataset.origin.
  static absl::StatusOr<std::unique_ptr<DatasetWriter>> Create(
      const std::filesystem::path& folder, std::string origin,
      const DatasetWriterOptions& options = {});
  // Without a Commit nothing remains.
  virtual ~DatasetWriter() = default;

  // INVALID_ARGUMENT, and nothing written, for a scenario that scene::ValidateScenario refuses or
  // that has no id; ALREADY_EXISTS for an id that was added before.
  virtual absl::Status Add(const v1::Scenario& scenario) = 0;
  // INVALID_ARGUMENT if it names no scenario.
  virtual absl::Status Add(const v1::ManeuverAnnotation& annotation) = 0;
  // Call once, last. FAILED_PRECONDITION if there is no recording.
  virtual absl::StatusOr<v1::Dataset> Commit() = 0;
};

// What is wrong with the manifest of a folder, before any file is looked at: file names (as the
// comment of Shard.file says, each once; never a path), sizes, digests, counts that do not add up.
// Fields are named from it: shards[0].file, ...
std::vector<scene::FieldViolation> ValidateDatasetManifest(const v1::Dataset& manifest);

// dataset.json from and to text.
absl::StatusOr<v1::Dataset> ParseDatasetManifest(const std::string& json);
std::string PrintDatasetManifest(const v1::Dataset& manifest);

// Dataset contents by one digest, as EvaluationReport.dataset_sha256 has it.
std::string ContentSha256(const v1::Dataset& manifest);

// dataset.json of a folder whose shards are there in the sizes it states. NOT_FOUND, or DATA_LOSS
// with the reason.
absl::StatusOr<v1::Dataset> ReadDatasetManifest(const std::filesystem::path& folder);

// Reads everything: SHA-256 and record count of each shard against the manifest, CRCs, and whether
// each record is a valid scenario with an id of its own, or an annotation of one of them. DATA_LOSS
// with file and reason.
absl::Status VerifyDatasetFolder(const std::filesystem::path& folder);

// What to do with a damaged record.
enum class OnDamage { kStop, kSkip };

// Calls `visit` with each recording, in order; stops early when it returns false. With kSkip,
// records that are damaged, or missing behind a damage to the framing, are passed over; their
// number is added to *skipped if that is given.
absl::Status ForEachScenario(const std::filesystem::path& folder, OnDamage on_damage,
                             const std::function<bool(v1::Scenario&&)>& visit,
                             int64_t* skipped = nullptr);
absl::Status ForEachAnnotation(const std::filesystem::path& folder, OnDamage on_damage,
                               const std::function<bool(v1::ManeuverAnnotation&&)>& visit);

// All recordings, in order, parsed on `threads` threads (0: one for each core). Stops at damage.
absl::StatusOr<std::vector<v1::Scenario>> ReadRecordings(const std::filesystem::path& folder,
                                                         int threads = 0);

// Reads the recording with this id from its place (recording_index.h). The first call for a folder
// without indexes reads all of it. NOT_FOUND if there is none.
absl::StatusOr<v1::Scenario> ReadScenario(const std::filesystem::path& folder,
                                          const std::string& scenario_id);

// Counts what is in a folder, on `threads` threads (0: one for each core) that hold a few
// recordings at a time. `examples` are those that EnumerateExamples finds by this spec and these
// settings (complete ones: artifact::ResolveTrainingSettings fills them in), with all standing
// ones. Types are named without their prefix: VEHICLE, LANE_CENTERLINE.
absl::StatusOr<v1::DatasetSummary> DescribeDataset(const std::filesystem::path& folder,
                                                   const v1::ModelSpec& spec,
                                                   const v1::ExampleSettings& settings,
                                                   int threads = 0);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_DATASET_FOLDER_H_
