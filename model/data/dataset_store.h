// The datasets of a server: one folder each, named by the dataset's id.

#ifndef MANEUVER_MODEL_DATA_DATASET_STORE_H_
#define MANEUVER_MODEL_DATA_DATASET_STORE_H_

#include <chrono>
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
  // Without a Commit what has arrived is kept for the next upload of this name by this caller.
  virtual ~DatasetUpload() = default;

  // The next bytes. Errors, each naming the shard: INVALID_ARGUMENT for more bytes than the
  // manifest says, DATA_LOSS for a shard with another SHA-256 (what came of it, now or before, is
  // thrown away), RESOURCE_EXHAUSTED for a full disk; ABORTED once another upload of this name by
  // this caller has begun.
  virtual absl::Status Append(std::string_view bytes) = 0;
  // Reads back and checks everything (VerifyDatasetFolder), then makes it a dataset in one step.
  // May take long. INVALID_ARGUMENT if bytes are missing, or with the shard, record and field of
  // what is no valid recording; ALREADY_EXISTS if another upload was first; DATA_LOSS as above.
  virtual absl::StatusOr<v1::Dataset> Commit() = 0;
  // Nothing of it is to be kept.
  virtual void Discard() = 0;
};

// Where uploads lie until they are datasets.
class UploadStaging;

struct DatasetStoreOptions {
  // Most that all datasets together may have, what has arrived of others included; 0: as much as
  // the disk holds.
  int64_t quota_bytes = 0;
  // What has arrived by an upload that broke off is removed so long after its last byte; 0: never.
  std::chrono::seconds keep_uploads = std::chrono::hours(24);
};

// Ids must be valid ones (security::ParseDatasetName). Datasets are immutable: what was read of one
// once stays true as long as it is there. Safe to use from any thread. NOT_FOUND for an unknown id.
class DatasetStore {
 public:
  // Creates the folder if need be and removes what interrupted commits and deletions left in it,
  // and uploads that are too old.
  static absl::StatusOr<std::unique_ptr<DatasetStore>> Open(
      std::filesystem::path folder, const DatasetStoreOptions& options = {});

  std::filesystem::path FolderOf(const std::string& id) const { return folder_ / id; }
  bool Contains(const std::string& id) const;
  absl::StatusOr<v1::Dataset> Get(const std::string& id) const;
  // Ids after `after`, sorted, at most `limit`.
  absl::StatusOr<std::vector<std::string>> List(const std::string& after, size_t limit) const;

  // Begins an upload, or goes on with one: what has arrived is this caller's alone.
  //   caller: who it is; empty where nobody is asked.
  //   arrived: [shards] bytes that are not sent, because QueryUpload said that they are there;
  //     empty: everything is sent.
  // Errors: ALREADY_EXISTS; INVALID_ARGUMENT is not checked here: see ValidateDatasetManifest;
  // RESOURCE_EXHAUSTED if it does not fit on the disk, FAILED_PRECONDITION if not within the quota,
  // beside what other uploads have announced; UNAVAILABLE if less has arrived than is said, or
  // while an earlier upload of this name is being committed: ask QueryUpload again.
  absl::StatusOr<std::unique_ptr<DatasetUpload>> BeginUpload(
      const std::string& id, const v1::Dataset& manifest, const std::string& caller = "",
      std::vector<int64_t> arrived = {}) const;
  // What need not be sent. The manifest is valid.
  absl::StatusOr<v1::QueryUploadResponse> QueryUpload(const std::string& id,
                                                      const v1::Dataset& manifest,
                                                      const std::string& caller = "") const;
  // Removes what uploads that broke off too long before `now` have left.
  absl::Status RemoveAbandonedUploads(std::filesystem::file_time_type now) const;

  // Takes a dataset away in one step. What is returned is a folder to be removed, which may take
  // long; if nobody does, the next Open will.
  absl::StatusOr<std::filesystem::path> Detach(const std::string& id);

  // The recordings at a glance, in order, from `begin`, at most `limit`. The first call for a
  // dataset reads all of it.
  absl::StatusOr<std::vector<v1::ScenarioSummary>> ListScenarios(const std::string& id,
                                                                 size_t begin, size_t limit);
  // Counts what is in a dataset; see DescribeDataset of dataset_folder.h. Reads all of it, on a
  // quarter of the cores, and keeps the answer beside the shards for the next time.
  absl::StatusOr<v1::DatasetSummary> Describe(const std::string& id, const v1::ModelSpec& spec,
                                              const v1::ExampleSettings& settings) const;
  // Reads the recording from its place, by the indexes of its dataset.
  absl::StatusOr<v1::Scenario> GetScenario(const std::string& id,
                                           const std::string& scenario_id) const;

 private:
  using Summaries = std::shared_ptr<const std::vector<v1::ScenarioSummary>>;

  DatasetStore(std::filesystem::path folder, const DatasetStoreOptions& options);
  absl::Status CheckRoom(uint64_t wanted, uint64_t arrived, uint64_t announced, uint64_t missing,
                         uint64_t broken_off) const;
  absl::StatusOr<int64_t> TotalBytes() const;
  absl::StatusOr<Summaries> SummariesOf(const std::string& id);

  const std::filesystem::path folder_;
  const DatasetStoreOptions options_;
  const std::shared_ptr<UploadStaging> staging_;
  std::mutex mutex_;
  // What ListScenarios read, by id and time of creation. Guarded by mutex_.
  std::map<std::pair<std::string, int64_t>, Summaries> summaries_;
};

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_DATASET_STORE_H_
