// The datasets of a server: one folder each, named by the dataset's id.

#ifndef MANEUVER_MODEL_DATA_DATASET_STORE_H_
#define MANEUVER_MODEL_DATA_DATASET_STORE_H_

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"
#include "maneuver/v1/dataset_service.pb.h"
#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_settings.pb.h"

namespace maneuver::data {

// One dataset on its way in: its shards' bytes, one after the other. Not thread-safe.
class DatasetUpload {
 public:
  // Without a Commit nothing remains.
  virtual ~DatasetUpload() = default;

  // The next bytes. Errors, each naming the shard: INVALID_ARGUMENT for more bytes than the
  // manifest says, DATA_LOSS for a shard with another SHA-256, RESOURCE_EXHAUSTED for a full disk.
  virtual absl::Status Append(std::string_view bytes) = 0;
  // Reads back and checks everything (VerifyDatasetFolder), then makes it a dataset in one step.
  // May take long. INVALID_ARGUMENT if bytes are missing, or with the shard, record and field of
  // what is no valid recording; ALREADY_EXISTS if another upload was first.
  virtual absl::StatusOr<v1::Dataset> Commit() = 0;
};

// What uploads under way have announced.
class Arrivals;

// Ids must be valid ones (security::ParseDatasetName). Datasets are immutable: what was read of one
// once stays true as long as it is there. Safe to use from any thread. NOT_FOUND for an unknown id.
class DatasetStore {
 public:
  // Creates the folder if need be and removes what interrupted uploads and deletions left in it.
  //   quota_bytes: most that all datasets together may have; 0: as much as the disk holds.
  static absl::StatusOr<std::unique_ptr<DatasetStore>> Open(std::filesystem::path folder,
                                                            int64_t quota_bytes = 0);

  std::filesystem::path FolderOf(const std::string& id) const { return folder_ / id; }
  bool Contains(const std::string& id) const;
  absl::StatusOr<v1::Dataset> Get(const std::string& id) const;
  // Ids after `after`, sorted, at most `limit`.
  absl::StatusOr<std::vector<std::string>> List(const std::string& after, size_t limit) const;

  // Begins an upload. ALREADY_EXISTS; INVALID_ARGUMENT is not checked here: see
  // ValidateDatasetManifest; RESOURCE_EXHAUSTED if it does not fit on the disk, FAILED_PRECONDITION
  // if not within the quota, beside what other uploads have announced.
  absl::StatusOr<std::unique_ptr<DatasetUpload>> BeginUpload(const std::string& id,
                                                             const v1::Dataset& manifest) const;

  // Takes a dataset away in one step. What is returned is a folder to be removed, which may take
  // long; if nobody does, the next Open will.
  absl::StatusOr<std::filesystem::path> Detach(const std::string& id);

  // The recordings at a glance, in order, from `begin`, at most `limit`. The first call for a
  // dataset reads all of it.
  absl::StatusOr<std::vector<v1::ScenarioSummary>> ListScenarios(const std::string& id,
                                                                 size_t begin, size_t limit);
  // Counts what is in a dataset; see DescribeDataset of dataset_folder.h. Reads all of it.
  absl::StatusOr<v1::DatasetSummary> Describe(const std::string& id, const v1::ModelSpec& spec,
                                              const v1::ExampleSettings& settings) const;
  // Reads up to the recording.
  absl::StatusOr<v1::Scenario> GetScenario(const std::string& id,
                                           const std::string& scenario_id) const;

 private:
  using Summaries = std::shared_ptr<const std::vector<v1::ScenarioSummary>>;

  DatasetStore(std::filesystem::path folder, int64_t quota_bytes);
  absl::StatusOr<int64_t> TotalBytes() const;
  absl::StatusOr<Summaries> SummariesOf(const std::string& id);

  const std::filesystem::path folder_;
  const int64_t quota_bytes_;
  const std::shared_ptr<Arrivals> arrivals_;
  std::mutex mutex_;
  // What ListScenarios read, by id and time of creation. Guarded by mutex_.
  std::map<std::pair<std::string, int64_t>, Summaries> summaries_;
};

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_DATASET_STORE_H_
