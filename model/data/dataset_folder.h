// A dataset on disk: TFRecord shards and a manifest, dataset.json.

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
#include "model/data/dataset_files.h"
#include "model/data/dataset_manifest.h"
#include "model/data/on_damage.h"

namespace maneuver::data {

// Puts a finished temporary folder with this manifest in the place of a dataset.
using PublishDataset = std::function<absl::Status(const std::filesystem::path& temporary,
                                                  const v1::Dataset& manifest)>;

struct DatasetWriterOptions {
  // A shard that reaches this size is closed, and the next one begins.
  int64_t shard_bytes = int64_t{64} << 20;
  // Publishes the dataset; empty: files::PublishFolder does.
  PublishDataset publish = {};
};

// Writes a new dataset folder completely or not at all: shards go to a temporary folder beside it,
// which Commit syncs and renames. Not thread-safe. Errors of all methods, besides those that they
// name: those of ErrnoStatus (errno_status.h).
class DatasetWriter {
 public:
  // Begins a dataset folder. ALREADY_EXISTS if `folder` exists. `origin` becomes Dataset.origin.
  static absl::StatusOr<std::unique_ptr<DatasetWriter>> Create(
      const std::filesystem::path& folder, std::string origin,
      const DatasetWriterOptions& options = {});
  // Removes everything that was written, unless Commit succeeded.
  virtual ~DatasetWriter() = default;

  // Appends a recording. An error means that nothing was appended: INVALID_ARGUMENT if
  // scene::ValidateScenario refuses the scenario or it has no id, ALREADY_EXISTS if an earlier
  // recording has its id.
  virtual absl::Status Add(const v1::Scenario& scenario) = 0;
  // Appends an annotation. INVALID_ARGUMENT if it names no scenario.
  virtual absl::Status Add(const v1::ManeuverAnnotation& annotation) = 0;
  // Completes the folder and returns its manifest. Call once, last. FAILED_PRECONDITION if there is
  // no recording.
  virtual absl::StatusOr<v1::Dataset> Commit() = 0;
};

// Reads and checks everything: the SHA-256 and record count of each shard, and the CRCs. Each
// record must be a valid scenario with a unique id, or an annotation of such a scenario. DATA_LOSS
// names the file and the reason; NOT_FOUND if the folder has no manifest.
absl::Status VerifyDatasetFolder(const std::filesystem::path& folder);

// Calls `visit` with each recording, in order, until it returns false. NOT_FOUND if the folder has
// no manifest. kStop returns DATA_LOSS, naming the file, at the first damage; before it calls
// `visit`, it checks the folder as ReadDatasetManifest does. kSkip skips damaged records. If the
// framing is damaged, it also skips all later records of that shard.
//   skipped: if given, incremented for each skipped record
absl::Status ForEachScenario(const std::filesystem::path& folder, OnDamage on_damage,
                             const std::function<bool(v1::Scenario&&)>& visit,
                             int64_t* skipped = nullptr);
absl::Status ForEachAnnotation(const std::filesystem::path& folder, OnDamage on_damage,
                               const std::function<bool(v1::ManeuverAnnotation&&)>& visit);

// Returns all recordings in order, parsed on `threads` threads (0: one per core). DATA_LOSS if
// anything is damaged.
absl::StatusOr<std::vector<v1::Scenario>> ReadRecordings(const std::filesystem::path& folder,
                                                         int threads = 0);

// Reads and returns the recording with this id from its place (recording_index.h). The first call
// for a folder without indexes reads all of it. NOT_FOUND if there is none.
absl::StatusOr<v1::Scenario> ReadScenario(const std::filesystem::path& folder,
                                          const std::string& scenario_id);

// Counts what a folder contains, on `threads` threads (0: one per core), which hold a few
// recordings at a time. `examples` counts what EnumerateExamples finds by this spec and these
// settings, without thinning standing targets. The settings must be complete
// (artifact::ResolveTrainingSettings). Types are named without their prefix: VEHICLE,
// LANE_CENTERLINE.
//   gives_up: asked before each recording, from any thread; once it returns true, ends with
//     CANCELLED
absl::StatusOr<v1::DatasetSummary> DescribeDataset(const std::filesystem::path& folder,
                                                   const v1::ModelSpec& spec,
                                                   const v1::ExampleSettings& settings,
                                                   int threads = 0,
                                                   const std::function<bool()>& gives_up = {});

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_DATASET_FOLDER_H_
