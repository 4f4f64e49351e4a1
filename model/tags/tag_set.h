// Opens folders of tags for queries.

#ifndef MANEUVER_MODEL_TAGS_TAG_SET_H_
#define MANEUVER_MODEL_TAGS_TAG_SET_H_

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "model/tags/shard_tags.h"
#include "model/tags/tag_folder.h"

namespace maneuver::tags {

// The tags of one shard, and the folder that they are in.
struct TaggedShard {
  std::shared_ptr<const Schema> schema;
  TagFile file;
  std::shared_ptr<const ShardTags> tags;

  const std::string& ActionName(int64_t action) const {
    return schema->content.action_names(static_cast<int>(action));
  }
  // Returns the id of the recording of a row.
  const std::string& Scene(size_t row) const {
    return tags->head().scenes(static_cast<int>(tags->Value(Column::kScene, row)));
  }
};

struct TagSet {
  std::vector<TaggedShard> shards;  // ordered by folder, then as in its schema
  int64_t missing = 0;              // shards that the schemas name and that have no tags yet

  // Opens all shards, but reads only their headers. Counts missing files instead of failing.
  // Errors: those of ReadSchema, naming the folder, and the others of ShardTags::Open.
  static absl::StatusOr<TagSet> Open(const std::vector<std::filesystem::path>& folders);
};

}  // namespace maneuver::tags

#endif  // MANEUVER_MODEL_TAGS_TAG_SET_H_
