// The layout of a dataset folder. Private to this folder's .cc files.

#ifndef MANEUVER_MODEL_DATA_DATASET_LAYOUT_H_
#define MANEUVER_MODEL_DATA_DATASET_LAYOUT_H_

#include <cstddef>
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
inline constexpr size_t kMaxOrigin = 1000;  // bytes of Dataset.origin

// Reads dataset.json and checks it by itself, without the shards. DATA_LOSS if any byte of it is
// damaged (files/sealed_json.h). One of an older release, or written by other tools, carries no
// digest, and damage may go unnoticed.
absl::StatusOr<v1::Dataset> LoadDatasetManifest(const std::filesystem::path& folder);
// Writes dataset.json, with its digest, in one step.
absl::Status WriteDatasetManifest(const std::filesystem::path& folder, const v1::Dataset& manifest);

// Visits a payload. Returns an error if it is not of the expected type; sets *more to false to
// stop.
using VisitPayload = std::function<absl::Status(const v1::Shard& shard, uint64_t offset,
                                                std::string&& payload, bool* more)>;

// Calls `visit` with each record of the shards of one content, in order. *skipped counts the
// records that kSkip leaves out.
absl::Status ForEachPayload(const std::filesystem::path& folder, v1::ShardContent content,
                            OnDamage on_damage, const VisitPayload& visit, int64_t* skipped);

// Does the same with each record of one shard. Stops at damage.
absl::Status ForEachPayloadOfShard(const std::filesystem::path& folder, const v1::Shard& shard,
                                   const VisitPayload& visit);

// Returns DATA_LOSS: "<file>, record at byte <offset>: not <what>".
absl::Status NotAMessage(const v1::Shard& shard, uint64_t offset, std::string_view what);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_DATASET_LAYOUT_H_
