// A dataset on disk: TFRecord shards and dataset.json.

#ifndef MANEUVER_MODEL_DATA_DATASET_FOLDER_H_
#define MANEUVER_MODEL_DATA_DATASET_FOLDER_H_

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

// Writes a new dataset folder, whole or not at all: shards go to a temporary folder beside it, which
// Commit syncs and renames. Not thread-safe.
class DatasetWriter {
 public:
  // ALREADY_EXISTS if `folder` exists. `origin` becomes Dataset.origin.
  static absl::StatusOr<std::unique_ptr<DatasetWriter>> Create(const std::filesystem::path& folder,
                                                               std::string origin);
  // Without a Commit nothing remains.
  virtual ~DatasetWriter() = default;

  virtual absl::Status Add(const v1::Scenario& scenario) = 0;
  virtual absl::Status Add(const v1::ManeuverAnnotation& annotation) = 0;
  virtual absl::StatusOr<v1::Dataset> Commit() = 0;
};

// dataset.json of a folder. NOT_FOUND, or DATA_LOSS with the reason.
absl::StatusOr<v1::Dataset> ReadDatasetManifest(const std::filesystem::path& folder);

// What to do with a damaged record.
enum class OnDamage { kStop, kSkip };

// Calls `visit` with each recording, in order; stops early when it returns false. The number of
// damaged records that were skipped is added to *skipped if that is given.
absl::Status ForEachScenario(const std::filesystem::path& folder, OnDamage on_damage,
                             const std::function<bool(v1::Scenario&&)>& visit,
                             int64_t* skipped = nullptr);
absl::Status ForEachAnnotation(const std::filesystem::path& folder, OnDamage on_damage,
                               const std::function<bool(v1::ManeuverAnnotation&&)>& visit);

// The recording with this id. NOT_FOUND if there is none.
absl::StatusOr<v1::Scenario> ReadScenario(const std::filesystem::path& folder,
                                          const std::string& scenario_id);

// Counts what is in a folder. `examples` are those of the resolved settings given.
absl::StatusOr<v1::DatasetSummary> DescribeDataset(const std::filesystem::path& folder);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_DATASET_FOLDER_H_
