// How a dataset folder is laid out; for the .cc files of this folder alone.

#ifndef MANEUVER_MODEL_DATA_DATASET_LAYOUT_H_
#define MANEUVER_MODEL_DATA_DATASET_LAYOUT_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"
#include "model/data/dataset_folder.h"

namespace maneuver::data {

inline constexpr char kManifestFile[] = "dataset.json";
inline constexpr int kDatasetFormatVersion = 1;

// dataset.json, valid in itself; the shards are not looked at.
absl::StatusOr<v1::Dataset> LoadDatasetManifest(const std::filesystem::path& folder);

// Returns an error for a payload that is not what it should be; clears *more to stop.
using VisitPayload = std::function<absl::Status(const v1::Shard& shard, uint64_t offset,
                                                std::string&& payload, bool* more)>;

// Calls `visit` with each record of the shards of one content, in order. *skipped counts those
// that kSkip passes over.
absl::Status ForEachPayload(const std::filesystem::path& folder, v1::ShardContent content,
                            OnDamage on_damage, const VisitPayload& visit, int64_t* skipped);

// The same with each record of one shard. Stops at damage.
absl::Status ForEachPayloadOfShard(const std::filesystem::path& folder, const v1::Shard& shard,
                                   const VisitPayload& visit);

// DATA_LOSS: "<file>, record at byte <offset>: not <what>".
absl::Status NotAMessage(const v1::Shard& shard, uint64_t offset, std::string_view what);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_DATASET_LAYOUT_H_
