#include "model/data/recording_index.h"

#include <algorithm>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "model/data/dataset_files.h"
#include "model/data/shard_index.h"
#include "model/data/tfrecord.h"

namespace maneuver::data {
namespace {

absl::StatusOr<ShardIndex> ReadOrRebuild(const std::filesystem::path& folder,
                                         const v1::Shard& shard,
                                         const RecordingIndex::Report& report) {
  absl::StatusOr<ShardIndex> index = ReadShardIndex(folder, shard);
  if (index.ok()) return index;
  const absl::Status unusable = index.status();
  index = BuildShardIndex(folder, shard);
  if (!index.ok()) return index;
  // Without a place to keep it, the index is built again the next time.
  (void)WriteShardIndex(folder, shard, *index);
  if (report && !absl::IsNotFound(unusable)) {
    report(absl::StrCat(std::string(unusable.message()), "; it was built anew"));
  }
  return index;
}

}  // namespace

absl::StatusOr<RecordingIndex> RecordingIndex::Open(const std::filesystem::path& folder,
                                                    const Report& report) {
  const absl::StatusOr<v1::Dataset> manifest = ReadDatasetManifest(folder);
  if (!manifest.ok()) return manifest.status();
  RecordingIndex all;
  all.folder_ = folder;
  for (const v1::Shard& shard : manifest->shards()) {
    if (shard.content() != v1::SHARD_CONTENT_SCENARIOS) continue;
    if (absl::Status status = all.Add(shard, report); !status.ok()) return status;
  }
  return all;
}

absl::StatusOr<RecordingIndex> RecordingIndex::OpenShard(const std::filesystem::path& folder,
                                                         const v1::Shard& shard,
                                                         const Report& report) {
  RecordingIndex one;
  one.folder_ = folder;
  if (absl::Status status = one.Add(shard, report); !status.ok()) return status;
  return one;
}

absl::Status RecordingIndex::Add(const v1::Shard& shard, const Report& report) {
  absl::StatusOr<ShardIndex> index = ReadOrRebuild(folder_, shard, report);
  if (!index.ok()) return index.status();
  const int number = static_cast<int>(shards_.size());
  shards_.push_back(shard.file());
  for (IndexedRecording& recording : *index->mutable_recordings()) {
    entries_.push_back({std::move(*recording.mutable_scenario_id()), number, recording.offset(),
                        recording.payload_bytes(), recording.payload_crc()});
  }
  return absl::OkStatus();
}

int64_t RecordingIndex::Find(const std::string& scenario_id) const {
  const auto found = std::ranges::find(entries_, scenario_id, &Entry::scenario_id);
  return found == entries_.end() ? -1 : found - entries_.begin();
}

absl::StatusOr<v1::Scenario> RecordingIndex::Read(size_t recording) const {
  const Entry& entry = entries_[recording];
  const std::string& shard = shards_[static_cast<size_t>(entry.shard)];
  const absl::StatusOr<std::string> payload =
      ReadRecordAt(folder_ / shard, entry.offset, entry.payload_bytes);
  if (!payload.ok()) return payload.status();
  v1::Scenario scenario;
  if (MaskedCrc32c(*payload) == entry.payload_crc && scenario.ParseFromString(*payload)) {
    return scenario;
  }
  return absl::DataLossError(absl::StrCat(
      shard, ", record at byte ", entry.offset, ": not the recording ", entry.scenario_id,
      " that was indexed; shards never change: restore the dataset, or import it anew"));
}

}  // namespace maneuver::data
