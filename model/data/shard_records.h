// Reads the records of a dataset's shards. Private to this folder's .cc files.

#ifndef MANEUVER_MODEL_DATA_SHARD_RECORDS_H_
#define MANEUVER_MODEL_DATA_SHARD_RECORDS_H_

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"
#include "model/data/on_damage.h"

namespace maneuver::data {

// Visits the payload of one record, which begins at byte `offset` of the shard. Returns an error if
// the payload is not a message of the expected type. Sets *more to false to stop.
using VisitPayload = std::function<absl::Status(const v1::Shard& shard, uint64_t offset,
                                                std::string&& payload, bool* more)>;

// Calls `visit` with each record of all shards that hold `content`, in order.
//   skipped: counts the records that kSkip leaves out
// Damage is also a record of more than 256 MiB, a compressed shard, and another number of records
// than the manifest states. With kStop it returns DATA_LOSS.
absl::Status ForEachPayload(const std::filesystem::path& folder, v1::ShardContent content,
                            OnDamage on_damage, const VisitPayload& visit, int64_t* skipped);

// Does the same with each record of one shard. Stops at damage.
absl::Status ForEachPayloadOfShard(const std::filesystem::path& folder, const v1::Shard& shard,
                                   const VisitPayload& visit);

// Returns DATA_LOSS: "<file>, record at byte <offset>: not <what>".
absl::Status NotAMessage(const v1::Shard& shard, uint64_t offset, std::string_view what);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_SHARD_RECORDS_H_
