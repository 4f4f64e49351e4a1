// Receives files one after the other into the slot of their upload.

#ifndef MANEUVER_MODEL_FILES_FILE_RECEIVER_H_
#define MANEUVER_MODEL_FILES_FILE_RECEIVER_H_

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
#include "model/files/digest.h"
#include "model/files/output_file.h"
#include "model/files/upload_staging.h"

namespace maneuver::files {

// What an upload announces.
struct FileUpload {
  std::string id;        // of what the files become; names the slot
  std::string resource;  // "datasets/town", for messages
  std::string noun;      // "shard": what messages call a file
  std::string caller;    // who uploads; empty if the server does not identify callers
  std::vector<AnnouncedFile> files;
  std::vector<int64_t> arrived = {};  // [files] bytes that are not sent; empty: everything is sent
};

// Not thread-safe.
class FileReceiver {
 public:
  // Checks whether there is room for an upload of `wanted` bytes, `arrived` of which are there,
  // beside the uploads in `others`.
  using CheckRoom = std::function<absl::Status(uint64_t wanted, uint64_t arrived,
                                               const UploadStaging::Others& others)>;

  // Begins or continues an upload. Errors: those of `check_room` and of UploadStaging::Announce;
  // UNAVAILABLE if fewer bytes have arrived than `upload.arrived` says, or while an earlier upload
  // of this id by this caller is being committed; errors of files.
  static absl::StatusOr<std::unique_ptr<FileReceiver>> Begin(std::shared_ptr<UploadStaging> staging,
                                                             FileUpload upload,
                                                             const CheckRoom& check_room);
  // Keeps the arrived bytes for this caller's next upload of this id, unless Append was given too
  // many, Commit says otherwise, or Discard was called.
  ~FileReceiver();
  FileReceiver(const FileReceiver&) = delete;
  FileReceiver& operator=(const FileReceiver&) = delete;

  // Adds the next bytes. Errors, each of which names the file: INVALID_ARGUMENT for more bytes than
  // announced; DATA_LOSS for a file with another SHA-256, which is then discarded, including bytes
  // of earlier calls; RESOURCE_EXHAUSTED for a full disk; ABORTED once another upload of this id by
  // this caller has begun.
  absl::Status Append(std::string_view bytes);

  // Puts the complete, verified files into a new temporary folder beside `beside`, and calls
  // `publish` to move it to its place. Removes the folder if it is still there afterwards.
  // INVALID_ARGUMENT if bytes are missing; errors of `publish`; otherwise as Append. After OK, and
  // INVALID_ARGUMENT or ALREADY_EXISTS of `publish`, nothing of the upload is kept.
  absl::Status Commit(
      const std::filesystem::path& beside,
      const std::function<absl::Status(const std::filesystem::path& temporary)>& publish);
  // Discards the upload: the destructor keeps nothing of it.
  void Discard() { discarded_ = true; }

 private:
  FileReceiver(std::shared_ptr<UploadStaging> staging, FileUpload upload,
               std::shared_ptr<UploadStaging::Slot> slot, int64_t turn);
  const AnnouncedFile& file() const { return upload_.files[next_]; }
  bool IsWhole(const AnnouncedFile& file) const;
  absl::Status CheckTurn() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(slot_->mutex);
  absl::Status Take(std::string_view bytes) ABSL_EXCLUSIVE_LOCKS_REQUIRED(slot_->mutex);
  absl::Status OpenPart() ABSL_EXCLUSIVE_LOCKS_REQUIRED(slot_->mutex);
  absl::Status FinishFullFiles() ABSL_EXCLUSIVE_LOCKS_REQUIRED(slot_->mutex);
  absl::Status ClosePart() ABSL_EXCLUSIVE_LOCKS_REQUIRED(slot_->mutex);
  absl::Status CheckComplete() ABSL_EXCLUSIVE_LOCKS_REQUIRED(slot_->mutex);
  void RemovePartWithoutAByte() ABSL_EXCLUSIVE_LOCKS_REQUIRED(slot_->mutex);

  absl::Status WrongDigest(const AnnouncedFile& file) const;
  absl::Status CheckEarlierFiles() const;
  absl::Status Fill(const std::filesystem::path& temporary) const;

  const std::shared_ptr<UploadStaging> staging_;
  const FileUpload upload_;
  const std::shared_ptr<UploadStaging::Slot> slot_;
  const int64_t turn_;
  std::vector<bool> was_whole_;  // [files] before this call
  size_t next_ = 0;              // file that is arriving
  std::unique_ptr<OutputFile> part_;
  std::unique_ptr<Sha256> digest_;
  absl::Status status_;
  bool discarded_ = false;
};

}  // namespace maneuver::files

#endif  // MANEUVER_MODEL_FILES_FILE_RECEIVER_H_
