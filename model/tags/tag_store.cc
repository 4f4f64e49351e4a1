#include "model/tags/tag_store.h"

#include <google/protobuf/util/json_util.h>
#include <google/protobuf/util/message_differencer.h>

#include <algorithm>
#include <limits>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "model/files/abandoned_temporaries.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "model/tags/tag_set.h"

namespace maneuver::tags {
namespace {

namespace fs = std::filesystem;

// v1::Tags without counts, as JSON. Hidden, so that it is no file of the tags.
constexpr char kBegunFile[] = ".begun.json";

absl::Status NoSuchTags(const std::string& id) {
  return absl::NotFoundError(absl::StrCat("there are no tags/", id));
}

// Returns the first field that decides about rows and differs; empty: none.
std::string DifferentField(const v1::Tags& begun, const v1::Tags& wanted) {
  if (begun.model_version() != wanted.model_version()) return "model_version";
  if (!std::ranges::equal(begun.datasets(), wanted.datasets())) return "datasets";
  if (begun.windows() != wanted.windows()) return "windows";
  const bool same_stride =
      begun.has_stride() == wanted.has_stride() &&
      google::protobuf::util::MessageDifferencer::Equals(begun.stride(), wanted.stride());
  return same_stride ? "" : "stride";
}

int64_t BytesIn(const fs::path& folder) {
  int64_t bytes = 0;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error); !error && entry != fs::directory_iterator();
       entry.increment(error)) {
    std::error_code gone;  // a temporary file that was renamed
    const uintmax_t size = entry->file_size(gone);
    if (!gone) bytes += static_cast<int64_t>(size);
  }
  return bytes;
}

}  // namespace

absl::Status TagStore::RemoveLeftovers(bool is_shared) const {
  std::error_code error;
  if (!fs::exists(folder_, error)) return absl::OkStatus();
  if (!is_shared) return files::RemoveTemporaries(folder_);
  files::RemoveAbandonedTemporaries(folder_, fs::file_time_type::clock::now());
  return absl::OkStatus();
}

bool TagStore::Contains(const std::string& id) const {
  std::error_code error;
  return fs::exists(FolderOf(id) / kBegunFile, error);
}

absl::StatusOr<v1::Tags> TagStore::Begun(const std::string& id) const {
  const auto json = files::ReadFile(FolderOf(id) / kBegunFile);
  if (absl::IsNotFound(json.status())) return NoSuchTags(id);
  if (!json.ok()) return json.status();
  v1::Tags tags;
  if (!google::protobuf::util::JsonStringToMessage(*json, &tags).ok()) {
    return absl::DataLossError(absl::StrCat("tags/", id, " is damaged; delete it and tag again"));
  }
  tags.set_name(absl::StrCat("tags/", id));
  return tags;
}

absl::Status TagStore::CheckBegin(const std::string& id, const v1::Tags& tags) const {
  const auto begun = Begun(id);
  if (absl::IsNotFound(begun.status())) return absl::OkStatus();
  if (!begun.ok()) return begun.status();
  const std::string field = DifferentField(*begun, tags);
  if (field.empty()) return absl::OkStatus();
  return absl::AlreadyExistsError(absl::StrCat("tags/", id, " has tags with another ", field,
                                               "; choose another name, or delete them first"));
}

absl::Status TagStore::Begin(const std::string& id, const v1::Tags& tags, bool* made) const {
  if (made != nullptr) *made = false;
  if (Contains(id)) return CheckBegin(id, tags);
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) return files::ErrnoStatus(error.value(), "create", folder_);
  fs::remove(FolderOf(id), error);  // an empty one, of a Withdraw that was interrupted
  const auto temporary = files::MakeTemporaryFolderFor(FolderOf(id));
  if (!temporary.ok()) return temporary.status();
  std::string json;
  if (!google::protobuf::util::MessageToJsonString(tags, &json).ok()) {
    return absl::InternalError(absl::StrCat("tags/", id, " cannot be described as JSON"));
  }
  absl::Status status = files::WriteFileAtomically(*temporary / kBegunFile, json + "\n");
  if (status.ok()) status = files::PublishFolder(*temporary, FolderOf(id));
  if (status.ok()) {
    if (made != nullptr) *made = true;
    return status;
  }
  fs::remove_all(*temporary, error);
  // Another server has just begun them.
  return absl::IsAlreadyExists(status) && Contains(id) ? CheckBegin(id, tags) : status;
}

void TagStore::Withdraw(const std::string& id) const {
  std::error_code ignored;
  fs::remove(FolderOf(id) / kBegunFile, ignored);
  fs::remove(FolderOf(id), ignored);
}

absl::StatusOr<v1::Tags> TagStore::Get(const std::string& id) const {
  absl::StatusOr<v1::Tags> tags = Begun(id);
  if (!tags.ok()) return tags;
  tags->set_size_bytes(BytesIn(FolderOf(id)));
  const absl::StatusOr<TagSet> set = TagSet::Open({FolderOf(id)});
  if (absl::IsNotFound(set.status())) return tags;  // no job has begun
  if (!set.ok()) {
    // Where the server keeps its data is not for callers.
    return absl::DataLossError(absl::StrReplaceAll(
        set.status().message(), {{FolderOf(id).string(), absl::StrCat("tags/", id)}}));
  }
  tags->set_shards(static_cast<int32_t>(set->shards.size()));
  tags->set_all_shards(static_cast<int32_t>(set->missing) + tags->shards());
  for (const TaggedShard& shard : set->shards) {
    tags->set_rows(tags->rows() + shard.tags->head().rows());
    tags->set_window_count(tags->window_count() + shard.tags->head().windows());
  }
  return tags;
}

absl::StatusOr<std::vector<std::string>> TagStore::List(const std::string& after,
                                                        size_t limit) const {
  std::vector<std::string> ids;
  std::error_code error;
  if (!fs::exists(folder_, error)) return ids;
  fs::directory_iterator entry(folder_, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    std::string name = entry->path().filename().string();
    if (name.front() != '.' && name > after && Contains(name)) ids.push_back(std::move(name));
  }
  if (error) return files::ErrnoStatus(error.value(), "read", folder_);
  std::ranges::sort(ids);
  if (ids.size() > limit) ids.resize(limit);
  return ids;
}

absl::StatusOr<std::optional<int64_t>> TagStore::Room() const {
  if (quota_bytes_ <= 0) return std::nullopt;
  const auto ids = List("", std::numeric_limits<size_t>::max());
  if (!ids.ok()) return ids.status();
  int64_t room = quota_bytes_;
  for (const std::string& id : *ids) room -= BytesIn(FolderOf(id));
  return std::max<int64_t>(0, room);
}

absl::StatusOr<fs::path> TagStore::Detach(const std::string& id) const {
  if (!Contains(id)) return NoSuchTags(id);
  auto aside = files::MoveAside(FolderOf(id));
  if (absl::IsNotFound(aside.status())) return NoSuchTags(id);
  return aside;
}

}  // namespace maneuver::tags
