// Uploads of versions from other servers. Arrived bytes stay in {models}/.uploads until the version
// is registered (model/files/upload_staging.h).

#ifndef MANEUVER_SERVER_SERVING_VERSION_UPLOADS_H_
#define MANEUVER_SERVER_SERVING_VERSION_UPLOADS_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "locks/mutex.h"
#include "maneuver/v1/model_service.pb.h"
#include "model/files/upload_staging.h"
#include "server/serving/serving_table.h"
#include "server/serving/version_store.h"

namespace maneuver::serving {

// One upload of a version: the bytes of its files, one file after the other. Not thread-safe.
class VersionUpload {
 public:
  // Keeps the arrived bytes for this caller's next upload to the model, unless Commit succeeded or
  // Discard was called.
  virtual ~VersionUpload() = default;

  // Adds the next bytes. Errors: as files::FileReceiver::Append.
  virtual absl::Status Append(std::string_view bytes) = 0;
  // Checks all files, loads the model once, and registers it as the model's next version without an
  // alias. If an earlier upload of the same files made a version, returns that one. May take long.
  // INVALID_ARGUMENT if the files are not a model that can be served. What has arrived is kept if
  // they cannot be read, or the disk is full.
  virtual absl::StatusOr<v1::ModelVersion> Commit() = 0;
  // Discards everything that has arrived.
  virtual void Discard() = 0;
};

// Returns an error for a folder that holds no model that can be served: DATA_LOSS, INVALID_ARGUMENT or
// NOT_FOUND for what it holds, another if it cannot be read.
using ModelCheck = std::function<absl::Status(const std::filesystem::path& folder)>;

// A ModelCheck that reads the whole model, and its baselines if it has any.
absl::Status CheckModelFolder(const std::filesystem::path& folder);

// All model ids must be valid. Safe to use from any thread.
class VersionUploads {
 public:
  // Opens the staging folder of uploads.
  //   folder: the folder of all models that `versions` was opened with
  //   versions, table: `table` must be the table of `versions`; both must outlive this object
  //   is_shared: other servers use the folder, too
  //   keep: an interrupted upload is removed this long after its last byte arrived; 0: never
  //   check: called for each new version, before it is registered, by several threads at once
  VersionUploads(std::filesystem::path folder, VersionStore& versions, ServingTable& table,
                 std::chrono::seconds keep, bool is_shared = false,
                 ModelCheck check = CheckModelFolder);

  // Begins or continues an upload. Only bytes that this caller sent count as arrived.
  //   header: its files must be valid (ValidateVersionFiles), and arrived_bytes must fit them.
  // RESOURCE_EXHAUSTED if the files do not fit on the disk beside other announced uploads.
  // UNAVAILABLE if fewer bytes have arrived than the header says, or while an earlier upload is
  // being committed.
  absl::StatusOr<std::unique_ptr<VersionUpload>> Begin(const std::string& model,
                                                       const v1::UploadModelHeader& header,
                                                       const std::string& caller);
  // Returns which bytes need not be sent, and the version that already has exactly these files, if
  // any. `files` must be valid.
  absl::StatusOr<v1::QueryModelUploadResponse> Query(
      const std::string& model, const google::protobuf::RepeatedPtrField<v1::ModelFile>& files,
      const std::string& caller);

  // Removes the bytes of uploads that were interrupted longer than `keep` before `now`.
  absl::Status RemoveAbandoned(std::filesystem::file_time_type now);

 private:
  absl::Status CheckRoom(uint64_t wanted, uint64_t arrived, uint64_t missing) const;

  const std::filesystem::path folder_;
  VersionStore& versions_;
  ServingTable& table_;
  const ModelCheck check_;
  Mutex registering_;  // so that the same files make one version
  const std::chrono::seconds keep_;
  const std::shared_ptr<files::UploadStaging> staging_;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_VERSION_UPLOADS_H_
