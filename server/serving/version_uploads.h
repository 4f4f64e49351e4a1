// Versions that come from elsewhere. What has arrived of one lies in {models}/.uploads until it is
// registered (model/files/upload_staging.h).

#ifndef MANEUVER_SERVER_SERVING_VERSION_UPLOADS_H_
#define MANEUVER_SERVER_SERVING_VERSION_UPLOADS_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/model_service.pb.h"
#include "model/files/upload_staging.h"
#include "server/serving/model_registry.h"

namespace maneuver::serving {

// One version on its way in: its files' bytes, one after the other. Not thread-safe.
class VersionUpload {
 public:
  // Without a Commit what has arrived is kept for this caller's next upload to the model.
  virtual ~VersionUpload() = default;

  // The next bytes. Errors as files::FileReceiver::Append.
  virtual absl::Status Append(std::string_view bytes) = 0;
  // Checks everything, loads the model once, and registers it as the model's next version, which no
  // alias points to. A version that an upload of just these files has made is not made again. May
  // take long. INVALID_ARGUMENT for files that are no model that can be served.
  virtual absl::StatusOr<v1::ModelVersion> Commit() = 0;
  // Nothing of it is to be kept.
  virtual void Discard() = 0;
};

// Model ids are valid ones. Safe to use from any thread.
class VersionUploads {
 public:
  //   folder: of all models, which `models` was opened with; `models` outlives this.
  //   keep: what has arrived by an upload that broke off is removed so long after its last byte; 0:
  //   never.
  VersionUploads(std::filesystem::path folder, ModelRegistry& models, std::chrono::seconds keep);

  // Begins an upload, or goes on with one: what has arrived is this caller's alone.
  //   header: its files are valid (ValidateVersionFiles), and arrived_bytes fits them.
  // RESOURCE_EXHAUSTED if it does not fit on the disk beside what other uploads have announced;
  // UNAVAILABLE if less has arrived than is said, or while an earlier upload is being committed.
  absl::StatusOr<std::unique_ptr<VersionUpload>> Begin(const std::string& model,
                                                       const v1::UploadModelHeader& header,
                                                       const std::string& caller);
  // What need not be sent, and the version that has just these files. `files` are valid.
  absl::StatusOr<v1::QueryModelUploadResponse> Query(
      const std::string& model, const google::protobuf::RepeatedPtrField<v1::ModelFile>& files,
      const std::string& caller);

  // Removes what uploads that broke off too long before `now` have left.
  absl::Status RemoveAbandoned(std::filesystem::file_time_type now);

 private:
  absl::Status CheckRoom(uint64_t wanted, uint64_t arrived, uint64_t missing) const;

  const std::filesystem::path folder_;
  ModelRegistry& models_;
  const std::chrono::seconds keep_;
  const std::shared_ptr<files::UploadStaging> staging_;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_VERSION_UPLOADS_H_
