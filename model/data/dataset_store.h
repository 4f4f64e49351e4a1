// The datasets of a server: one folder each, named by the dataset's id.
//
// Without a ledger a dataset exists while its folder is there. With one (dataset_ledger.h) it
// exists while the ledger lists it. Then what lists, counts and gets datasets does not read the
// folder. A folder that the ledger does not know is added to it when a store opens, by AdoptFolders
// and AdoptNewFolders, and when its id is asked for. It is whole: a server died while it published
// it, or a server without the ledger made it.

#ifndef MANEUVER_MODEL_DATA_DATASET_STORE_H_
#define MANEUVER_MODEL_DATA_DATASET_STORE_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "locks/mutex.h"
#include "maneuver/v1/dataset.pb.h"
#include "maneuver/v1/dataset_service.pb.h"
#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/data/dataset_ledger.h"
#include "model/data/dataset_upload.h"
#include "model/data/opened_indexes.h"

namespace maneuver::files {
class UploadStaging;
}

namespace maneuver::data {

class DatasetWriter;  // dataset_folder.h

struct DatasetStoreOptions {
  // The most bytes that all datasets and unfinished uploads may have together; 0: only the disk
  // limits them. Datasets in place do not count.
  int64_t quota_bytes = 0;
  // Folders that may become datasets in place, with all that is below them; empty: none may.
  std::vector<std::filesystem::path> folders = {};
  // How long the bytes of an interrupted upload are kept after the last one arrived; 0: forever.
  std::chrono::seconds keep_uploads = std::chrono::hours(24);
  // Whether other servers use the folder, too.
  bool is_shared = false;
};

// Ids must be valid (security::ParseDatasetName). Datasets are immutable: what a caller has read
// stays true for as long as the dataset exists. Reading, describing or detaching an unknown dataset
// returns NOT_FOUND. Other errors, besides those that a method names: DATA_LOSS for a damaged
// dataset, or one whose folder is gone from under the ledger; those of ErrnoStatus (errno_status.h)
// and of the ledger. Thread-safe.
class DatasetStore {
 public:
  // Opens the store and creates its folder if needed. Removes what interrupted commits and
  // deletions left, and uploads that are too old. Calls AdoptFolders.
  //   ledger: nullptr if no other server can ever use the folder; must outlive the store
  static absl::StatusOr<std::unique_ptr<DatasetStore>> Open(std::filesystem::path folder,
                                                            const DatasetStoreOptions& options = {},
                                                            DatasetLedger* ledger = nullptr);

  std::filesystem::path FolderOf(const std::string& id) const { return folder_ / id; }
  // Returns OK if the dataset exists and its folder is there, and NOT_FOUND if it does not exist.
  absl::Status CheckExists(const std::string& id) const;
  bool Contains(const std::string& id) const { return CheckExists(id).ok(); }
  absl::StatusOr<v1::Dataset> Get(const std::string& id) const;
  // Reads the manifest beside the shards, and compares it with them (ReadDatasetManifest). Asks the
  // ledger only why that failed.
  absl::StatusOr<v1::Dataset> Read(const std::string& id) const;
  // Returns at most `limit` manifests, by id, that come after the id `after`. One that is damaged
  // has a name alone, so that it can be seen and deleted.
  absl::StatusOr<std::vector<v1::Dataset>> List(const std::string& after, size_t limit) const;

  // Begins or continues an upload. Callers never share what has arrived.
  //   caller: the caller's identity; empty if the server does not authenticate callers.
  //   arrived: [shards] bytes that are not sent, because QueryUpload reported them; empty:
  //     everything is sent.
  // Errors (the caller checks the manifest first, with ValidateDatasetManifest):
  //   ALREADY_EXISTS: the dataset exists.
  //   RESOURCE_EXHAUSTED: it does not fit on the disk beside the announced bytes of other uploads.
  //   FAILED_PRECONDITION: it does not fit within the quota beside them.
  //   UNAVAILABLE: less has arrived than `arrived` states, or an earlier upload of this name is
  //     being committed. Call QueryUpload again.
  absl::StatusOr<std::unique_ptr<DatasetUpload>> BeginUpload(
      const std::string& id, const v1::Dataset& manifest, const std::string& caller = "",
      std::vector<int64_t> arrived = {}) const;
  // Begins a dataset that the server itself writes, from about this many bytes of recordings. It
  // exists once it is committed. Errors: ALREADY_EXISTS, RESOURCE_EXHAUSTED and FAILED_PRECONDITION
  // as in BeginUpload.
  absl::StatusOr<std::unique_ptr<DatasetWriter>> Create(const std::string& id,
                                                        const std::string& origin,
                                                        int64_t bytes) const;
  // Returns how many bytes of each shard have arrived, which need not be sent again, and the
  // dataset itself if it exists with the same shards. The manifest must be valid.
  absl::StatusOr<v1::QueryUploadResponse> QueryUpload(const std::string& id,
                                                      const v1::Dataset& manifest,
                                                      const std::string& caller = "") const;
  // Returns whether Register may use the folder: OK, or its INVALID_ARGUMENT or PERMISSION_DENIED.
  absl::Status CheckRegistrable(const std::filesystem::path& folder) const;
  // Makes a folder elsewhere on the disk a dataset in place (registered_folder.h), after the checks
  // of an upload's Commit. May take long. Changes nothing if the same folder is registered under
  // this id already. Errors, which name the file:
  //   INVALID_ARGUMENT: it is not an absolute path of a folder that holds a whole, valid dataset.
  //   PERMISSION_DENIED: it does not lie in one of DatasetStoreOptions.folders.
  //   ALREADY_EXISTS: there is another dataset of this id.
  absl::StatusOr<v1::Dataset> Register(const std::string& id,
                                       const std::filesystem::path& folder) const;
  // Removes what interrupted uploads left if their last byte arrived more than keep_uploads before
  // `now`.
  absl::Status RemoveAbandonedUploads(std::filesystem::file_time_type now) const;
  // Adds folders that the ledger does not know to it, but for those whose manifest is damaged.
  // Removes nothing from it: folders may be away. OK if there is no ledger.
  absl::Status AdoptFolders() const;
  // Does the same if a name in the folder has changed since the last call that returned OK. Cheap
  // enough for once a second.
  absl::Status AdoptNewFolders();

  // Removes a dataset from the store in one step. The caller should then delete the returned
  // folder, which may take long; otherwise the next Open does. If the ledger is lost meanwhile, the
  // dataset may stay on its list without a folder. Detaching it again removes it.
  absl::StatusOr<std::filesystem::path> Detach(const std::string& id);

  // Returns summaries of at most `limit` recordings, in order, from index `begin`. Reads these
  // recordings from their places, by the indexes of their dataset.
  absl::StatusOr<std::vector<v1::ScenarioSummary>> ListScenarios(const std::string& id,
                                                                 size_t begin, size_t limit) const;
  // Counts what a dataset contains (DescribeDataset, dataset_folder.h). Reads all of it on a
  // quarter of the cores, at most four, and keeps the answer beside the shards for the next call.
  absl::StatusOr<v1::DatasetSummary> Describe(const std::string& id, const v1::ModelSpec& spec,
                                              const v1::ExampleSettings& settings,
                                              const std::function<bool()>& gives_up = {}) const;
  // Returns one recording. Reads it from its place, by the indexes of its dataset. NOT_FOUND if the
  // dataset does not have it.
  absl::StatusOr<v1::Scenario> GetScenario(const std::string& id,
                                           const std::string& scenario_id) const;

 private:
  DatasetStore(std::filesystem::path folder, const DatasetStoreOptions& options,
               DatasetLedger* ledger);
  // Returns OK if the folder of a dataset is there, and NOT_FOUND if it is not.
  absl::Status CheckFolder(const std::string& id) const;
  // Returns ALREADY_EXISTS unless a dataset of this id may be made.
  absl::Status CheckAbsent(const std::string& id) const;
  // Returns the names in the folder that may be datasets, sorted.
  absl::StatusOr<std::vector<std::string>> FolderNames() const;
  // Adds the folder of `id` to the ledger, unless it is there. NOT_FOUND if there is none.
  absl::Status AdoptFolder(const std::string& id) const;
  absl::StatusOr<std::filesystem::path> MoveOut(const std::string& id) const;
  // Takes a dataset from the list, and MoveOut. Returns an empty path if the folder is gone
  // already.
  absl::StatusOr<std::filesystem::path> Unlist(const std::string& id) const;
  absl::Status CheckRoom(uint64_t wanted, uint64_t arrived, uint64_t announced, uint64_t missing,
                         uint64_t broken_off) const;
  absl::StatusOr<int64_t> TotalBytes() const;
  // Returns why reading a dataset failed: NOT_FOUND if it was removed meanwhile; else `status`.
  absl::Status WhyUnread(const std::string& id, absl::Status status) const;
  absl::StatusOr<std::shared_ptr<const OpenedIndex>> IndexOf(const std::string& id) const;

  const std::filesystem::path folder_;
  const DatasetStoreOptions options_;
  DatasetLedger* const ledger_;  // nullptr: none
  const std::shared_ptr<files::UploadStaging> staging_;
  mutable OpenedIndexes indexes_;
  Mutex mutex_;
  // When the folder had last changed before AdoptNewFolders read it.
  std::filesystem::file_time_type adopted_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_DATASET_STORE_H_
