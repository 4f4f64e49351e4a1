#include "model/tags/tag_set.h"

#include <utility>

#include "absl/strings/str_cat.h"

namespace maneuver::tags {

absl::StatusOr<TagSet> TagSet::Open(const std::vector<std::filesystem::path>& folders) {
  TagSet set;
  for (const std::filesystem::path& folder : folders) {
    absl::StatusOr<Schema> read = ReadSchema(folder);
    if (!read.ok()) {
      return absl::Status(read.status().code(),
                          absl::StrCat(folder.string(), ": ", read.status().message()));
    }
    const auto schema = std::make_shared<const Schema>(*std::move(read));
    for (const TagFile& file : schema->content.files()) {
      absl::StatusOr<std::shared_ptr<const ShardTags>> tags =
          ShardTags::Open(folder, *schema, file);
      if (absl::IsNotFound(tags.status())) {
        ++set.missing;
        continue;
      }
      if (!tags.ok()) return tags.status();
      set.shards.push_back({schema, file, *std::move(tags)});
    }
  }
  return set;
}

}  // namespace maneuver::tags
