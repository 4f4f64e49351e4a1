// Reads and writes the index file of one shard. Private to this folder's .cc files.

#ifndef MANEUVER_MODEL_DATA_SHARD_INDEX_H_
#define MANEUVER_MODEL_DATA_SHARD_INDEX_H_

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"
#include "shard_index.pb.h"

namespace maneuver::data {

// Returns the path of ".<shard>.index", beside the shard. No shard may have such a name.
std::filesystem::path IndexFileOf(const std::filesystem::path& folder, const v1::Shard& shard);

// Adds the record that follows the others to the index of its shard.
//   offset: of the record in the shard, bytes
void AddToIndex(std::string_view scenario_id, uint64_t offset, std::string_view payload,
                ShardIndex* index);

// Reads the index of a shard. NOT_FOUND if there is none; DATA_LOSS, naming the file, if it is
// damaged, has another format, or belongs to a shard with other content.
absl::StatusOr<ShardIndex> ReadShardIndex(const std::filesystem::path& folder,
                                          const v1::Shard& shard);

// Reads the shard from front to back and checks its SHA-256 and all CRCs. DATA_LOSS with the file
// and the reason if it is not the shard that the manifest describes.
absl::StatusOr<ShardIndex> BuildShardIndex(const std::filesystem::path& folder,
                                           const v1::Shard& shard);

// Writes the index beside its shard, completely or not at all, with the shard's digest in it.
absl::Status WriteShardIndex(const std::filesystem::path& folder, const v1::Shard& shard,
                             ShardIndex index);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_SHARD_INDEX_H_
