// Keeps uploaded files until they become a dataset or a version of a model. Arrived bytes outlive
// the call that brought them.
//
//   <folder>/.uploads/<id>.<caller>/<SHA-256>       a complete file, named by its digest
//                                  /<SHA-256>.part  the beginning of a file
//                                  /.announced      where other servers use the folder, too: which
//                                                   call has the turn, and how many bytes it
//                                                   announced
//   <folder>/.uploads.lock                          held by a server that compares announcements
//
// <id> is the id of what the files become, <caller> a digest of the caller's name. An upload only
// uses files of the same caller and id. So a caller that knows the digest of another caller's file
// cannot find out that it is here, and does not get its bytes.

#ifndef MANEUVER_MODEL_FILES_UPLOAD_STAGING_H_
#define MANEUVER_MODEL_FILES_UPLOAD_STAGING_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "locks/mutex.h"

namespace maneuver::files {

// A file as its sender announces it.
struct AnnouncedFile {
  std::string name;  // within the folder that it becomes part of; a safe one
  int64_t size_bytes = 0;
  std::string sha256;  // lower-case hexadecimal
};

// Returns the sum of the sizes, or the largest uint64_t if they overflow.
uint64_t BytesOf(const std::vector<AnnouncedFile>& files);

// Return the paths of a complete and of a partial file in the slot's folder.
std::filesystem::path WholeFile(const std::filesystem::path& slot, const AnnouncedFile& file);
std::filesystem::path PartOfFile(const std::filesystem::path& slot, const AnnouncedFile& file);

// Returns for each file how many of its first bytes are there. The beginning of a file counts for
// the first of several files that have the same content.
std::vector<int64_t> ArrivedBytes(const std::filesystem::path& slot,
                                  const std::vector<AnnouncedFile>& files);
// Removes everything in the slot that belongs to none of the files.
void RemoveOtherFiles(const std::filesystem::path& slot, const std::vector<AnnouncedFile>& files);

// Thread-safe.
class UploadStaging {
 public:
  // The bytes that an upload in progress has announced.
  struct Bytes {
    uint64_t announced = 0;
    uint64_t missing = 0;  // the part of `announced` that is not on the disk yet
  };
  struct Others {
    Bytes under_way;
    uint64_t broken_off = 0;  // on the disk, of interrupted uploads
  };
  // One caller's upload under one id. If several calls send it, the latest one has the turn.
  struct Slot {
    std::string name;
    std::filesystem::path folder;
    Mutex mutex;  // also guards the files; taken before UploadStaging's
    int64_t turn ABSL_GUARDED_BY(mutex) = 0;
    bool committing ABSL_GUARDED_BY(mutex) = false;  // no other call may take the turn
  };

  //   is_shared: other servers use the folder, too. Turns and announcements then hold over all.
  explicit UploadStaging(const std::filesystem::path& folder, bool is_shared = false);

  // Returns the slot. Its folder need not exist. While the pointer is held, the slot is not
  // abandoned.
  std::shared_ptr<Slot> Enter(const std::string& id, const std::string& caller);

  // Replaces what the slot announced before, unless `refuse` returns an error. `refuse` is called
  // with the totals of the other slots. If the folder is shared, takes the turn from calls of other
  // servers; UNAVAILABLE if another server holds the lock for 5 s, and errors of files.
  absl::Status Announce(Slot& slot, const Bytes& bytes,
                        const std::function<absl::Status(const Others&)>& refuse);
  // Returns false if a call of another server has announced the slot since. Errors: those of
  // ErrnoStatus.
  absl::StatusOr<bool> HasTurn(const Slot& slot);
  // Records that `bytes` of the announced missing ones are on the disk now.
  void Arrived(Slot& slot, uint64_t bytes);
  // Ends the announcement. Call it when no call sends the upload any more.
  void End(Slot& slot);

  // Makes the slot's folder, if it is missing. Errors: those of ErrnoStatus.
  absl::Status MakeFolder(const Slot& slot);
  // Remove the folder with its content, or only if it is empty.
  void RemoveFolder(const Slot& slot);
  void RemoveEmptyFolder(const Slot& slot);

  // Removes the slots that no call uses and for which `is_over` returns true. Errors: those of
  // ErrnoStatus.
  //   last: when the last byte arrived
  absl::Status RemoveIf(const std::function<bool(const std::string& id,
                                                 std::filesystem::file_time_type last)>& is_over);

 private:
  bool IsHeld(const std::string& name) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  uint64_t BrokenOffBytes() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Returns what all servers have on the disk, except for `own`.
  Others OthersOnDisk(const std::string& own) const;

  const std::filesystem::path folder_;
  const bool is_shared_;
  // Held while the lock of a shared folder is waited for, so that this server's uploads take turns.
  Mutex announcing_ ABSL_ACQUIRED_BEFORE(mutex_);
  Mutex mutex_;
  // Bytes that each slot has announced, by the slot's name, and their sum.
  std::map<std::string, Bytes> announced_ ABSL_GUARDED_BY(mutex_);
  Bytes under_way_ ABSL_GUARDED_BY(mutex_);
  std::map<std::string, std::weak_ptr<Slot>> slots_ ABSL_GUARDED_BY(mutex_);
  // If the folder is shared: what this server's last announcement of a slot begins with.
  std::map<std::string, std::string> turns_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace maneuver::files

#endif  // MANEUVER_MODEL_FILES_UPLOAD_STAGING_H_
