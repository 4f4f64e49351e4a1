// Keeps the bytes of uploads until they become datasets. Private to this folder's .cc files. What
// has arrived outlives the call that sent it.
//
//   <datasets>/.uploads/<dataset>.<caller>/<SHA-256>       a complete shard with that digest
//                                         /<SHA-256>.part  the beginning of a shard
//
// <caller> is a digest of the caller's identity. Shards are searched only among those of the same
// caller and dataset name. Whoever knows the digest of somebody else's shard learns nothing from it
// and cannot get its bytes.

#ifndef MANEUVER_MODEL_DATA_UPLOAD_STAGING_H_
#define MANEUVER_MODEL_DATA_UPLOAD_STAGING_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "maneuver/v1/dataset.pb.h"

namespace maneuver::data {

// Returns the sum of the shards' sizes, saturated at the largest number.
uint64_t BytesOf(const v1::Dataset& manifest);

// Return the files of a shard in its slot's folder.
std::filesystem::path WholeShard(const std::filesystem::path& slot, const v1::Shard& shard);
std::filesystem::path PartOfShard(const std::filesystem::path& slot, const v1::Shard& shard);

// Returns, for each shard of the manifest, how many of its first bytes have arrived.
std::vector<int64_t> ArrivedBytes(const std::filesystem::path& slot, const v1::Dataset& manifest);
// Removes the files that belong to no shard of the manifest.
void RemoveOtherShards(const std::filesystem::path& slot, const v1::Dataset& manifest);

// Thread-safe.
class UploadStaging {
 public:
  // The bytes that an upload in progress has announced.
  struct Bytes {
    uint64_t announced = 0;
    uint64_t missing = 0;  // of these, those not on the disk yet
  };
  struct Others {
    Bytes under_way;
    uint64_t broken_off = 0;  // on the disk, of interrupted uploads
  };
  // One caller's upload of one dataset. If several calls send it, the latest one has the turn.
  struct Slot {
    std::string name;
    std::filesystem::path folder;
    std::mutex mutex;  // guards what follows and the files; locked before UploadStaging's
    int64_t turn = 0;
    bool committing = false;  // no other call may take the turn
    Bytes bytes;              // of the call that has the turn; guarded by UploadStaging
  };

  explicit UploadStaging(std::filesystem::path datasets);

  // Returns the slot. Its folder need not exist. While the pointer is held, the slot is not
  // abandoned.
  std::shared_ptr<Slot> Enter(const std::string& id, const std::string& caller);

  // Replaces what the slot announced before, unless `refuse` returns an error. `refuse` is called
  // with the totals of the other slots.
  absl::Status Announce(Slot& slot, const Bytes& bytes,
                        const std::function<absl::Status(const Others&)>& refuse);
  void Arrived(Slot& slot, uint64_t bytes);
  // Ends the announcement: no call sends the upload any more.
  void End(Slot& slot);

  absl::Status MakeFolder(const Slot& slot);
  // Remove the folder with its content, or only if it is empty.
  void RemoveFolder(const Slot& slot);
  void RemoveEmptyFolder(const Slot& slot);

  // Removes slots that no call sends and for which `is_over` (dataset, time of the last byte) is
  // true.
  absl::Status RemoveIf(const std::function<bool(const std::string& id,
                                                 std::filesystem::file_time_type last)>& is_over);

 private:
  // Require mutex_.
  bool IsHeld(const std::string& name) const;
  uint64_t BrokenOffBytes() const;

  const std::filesystem::path folder_;
  std::mutex mutex_;
  // Guarded by mutex_.
  Bytes under_way_;
  std::map<std::string, std::weak_ptr<Slot>> slots_;
};

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_UPLOAD_STAGING_H_
