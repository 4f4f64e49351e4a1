#include "model/data/shard_records.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_files.h"
#include "model/data/dataset_manifest.h"
#include "model/data/tfrecord.h"

namespace maneuver::data {
namespace {

// Datasets come from other people: refuse compressed files and enormous records.
constexpr TfRecordReaderOptions kShardOptions = {.max_record_bytes = uint64_t{256} << 20,
                                                 .allow_gzip = false};

absl::Status WrongCount(const v1::Shard& shard, int64_t seen) {
  return absl::DataLossError(absl::StrCat("shard ", shard.file(), " has ", seen, " records; ",
                                          kManifestFile, " says ", shard.records()));
}

absl::Status ReadShard(const std::filesystem::path& folder, const v1::Shard& shard,
                       OnDamage on_damage, const VisitPayload& visit, bool* more,
                       int64_t* skipped) {
  auto reader = TfRecordReader::Open(folder / shard.file(), kShardOptions);
  if (!reader.ok()) return reader.status();
  std::string payload;
  int64_t seen = 0;
  while (*more) {
    absl::Status status = (*reader)->Next(&payload);
    if (absl::IsOutOfRange(status)) break;
    if (status.ok()) status = visit(shard, (*reader)->offset(), std::move(payload), more);
    if (!status.ok() && on_damage == OnDamage::kStop) return status;
    if (!(*reader)->can_continue()) break;
    ++seen;
    if (!status.ok()) ++*skipped;
  }
  if (*more && seen != shard.records()) {
    if (on_damage == OnDamage::kStop) return WrongCount(shard, seen);
    *skipped += std::max<int64_t>(0, shard.records() - seen);
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status NotAMessage(const v1::Shard& shard, uint64_t offset, std::string_view what) {
  return absl::DataLossError(absl::StrCat(shard.file(), ", record at byte ", offset, ": not ",
                                          absl::string_view(what.data(), what.size())));
}

absl::Status ForEachPayload(const std::filesystem::path& folder, v1::ShardContent content,
                            OnDamage on_damage, const VisitPayload& visit, int64_t* skipped) {
  // When damage is skipped, a shard of the wrong size is no reason to stop.
  const auto manifest =
      on_damage == OnDamage::kStop ? ReadDatasetManifest(folder) : LoadDatasetManifest(folder);
  if (!manifest.ok()) return manifest.status();
  bool more = true;
  for (const v1::Shard& shard : manifest->shards()) {
    if (shard.content() != content) continue;
    absl::Status status = ReadShard(folder, shard, on_damage, visit, &more, skipped);
    if (!status.ok()) return status;
    if (!more) break;
  }
  return absl::OkStatus();
}

absl::Status ForEachPayloadOfShard(const std::filesystem::path& folder, const v1::Shard& shard,
                                   const VisitPayload& visit) {
  bool more = true;
  int64_t skipped = 0;
  return ReadShard(folder, shard, OnDamage::kStop, visit, &more, &skipped);
}

}  // namespace maneuver::data
