// The tags of a server: one folder each, named by its id.

#ifndef MANEUVER_MODEL_TAGS_TAG_STORE_H_
#define MANEUVER_MODEL_TAGS_TAG_STORE_H_

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/tag_service.pb.h"

namespace maneuver::tags {

// Ids must be valid (security::ParseTagsName). A folder of tags grows while jobs tag into it; its
// complete files do not change. Reading or detaching unknown tags returns NOT_FOUND. Thread-safe.
class TagStore {
 public:
  //   folder: made when the first tags begin
  //   quota_bytes: the most that all tags may have together; 0: only the disk limits them
  explicit TagStore(std::filesystem::path folder, int64_t quota_bytes = 0)
      : folder_(std::move(folder)), quota_bytes_(quota_bytes) {}

  // Removes what interrupted calls left.
  //   is_shared: other servers use the folder, too
  absl::Status RemoveLeftovers(bool is_shared) const;

  std::filesystem::path FolderOf(const std::string& id) const { return folder_ / id; }
  bool Contains(const std::string& id) const;

  // Returns whether Begin may be called: OK, or its ALREADY_EXISTS.
  absl::Status CheckBegin(const std::string& id, const v1::Tags& tags) const;
  // Makes a folder for tags, unless it is there. ALREADY_EXISTS, naming the field, if it is there
  // for another model_version, datasets, windows or stride.
  //   tags: kept as it is given, for Get
  //   made: set to whether this call made the folder; nullptr: not wanted
  absl::Status Begin(const std::string& id, const v1::Tags& tags, bool* made = nullptr) const;
  // Removes tags that Begin made and that have no files yet. Needs no room on the disk.
  void Withdraw(const std::string& id) const;

  // Returns what Begin was given, with name, counts and size_bytes of the files that are there.
  // DATA_LOSS if a file is damaged.
  absl::StatusOr<v1::Tags> Get(const std::string& id) const;
  // Returns at most `limit` ids after `after`, sorted.
  absl::StatusOr<std::vector<std::string>> List(const std::string& after, size_t limit) const;
  // Returns how many bytes more all tags may have together; nothing if there is no quota.
  absl::StatusOr<std::optional<int64_t>> Room() const;

  // Removes tags from the store in one step. The caller should then delete the returned folder,
  // which may take long; otherwise RemoveLeftovers does.
  absl::StatusOr<std::filesystem::path> Detach(const std::string& id) const;

 private:
  absl::StatusOr<v1::Tags> Begun(const std::string& id) const;

  const std::filesystem::path folder_;
  const int64_t quota_bytes_;
};

}  // namespace maneuver::tags

#endif  // MANEUVER_MODEL_TAGS_TAG_STORE_H_
