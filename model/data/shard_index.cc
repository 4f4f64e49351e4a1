#include "model/data/shard_index.h"

#include <cstring>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_manifest.h"
#include "model/data/shard_records.h"
#include "model/data/tfrecord.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"

namespace maneuver::data {
namespace {

namespace fs = std::filesystem;

constexpr int kIndexFormatVersion = 1;

absl::Status BadIndex(const fs::path& file, absl::string_view what) {
  return absl::DataLossError(absl::StrCat("index ", files::NameOf(file), " ", what));
}

}  // namespace

fs::path IndexFileOf(const fs::path& folder, const v1::Shard& shard) {
  return folder / absl::StrCat(".", shard.file(), ".index");
}

void AddToIndex(std::string_view scenario_id, uint64_t offset, std::string_view payload,
                ShardIndex* index) {
  IndexedRecording& recording = *index->add_recordings();
  recording.set_scenario_id(scenario_id.data(), scenario_id.size());
  recording.set_offset(offset);
  recording.set_payload_bytes(payload.size());
  recording.set_payload_crc(MaskedCrc32c(payload));
}

absl::StatusOr<ShardIndex> ReadShardIndex(const fs::path& folder, const v1::Shard& shard) {
  const fs::path file = IndexFileOf(folder, shard);
  const absl::StatusOr<std::string> content = files::ReadFile(file);
  if (!content.ok()) return content.status();
  // A masked CRC-32C, then the message.
  uint32_t crc = 0;
  if (content->size() < sizeof(crc)) return BadIndex(file, "is damaged: it is too short");
  std::memcpy(&crc, content->data(), sizeof(crc));
  const std::string_view message = std::string_view(*content).substr(sizeof(crc));
  ShardIndex index;
  if (MaskedCrc32c(message) != crc ||
      !index.ParseFromArray(message.data(), static_cast<int>(message.size()))) {
    return BadIndex(file, "is damaged (CRC-32C)");
  }
  if (index.format_version() != kIndexFormatVersion) {
    return BadIndex(file, absl::StrCat("has format ", index.format_version()));
  }
  if (index.shard_sha256() != shard.sha256() || index.recordings_size() != shard.records()) {
    return BadIndex(file, "is stale: the shard has another content now");
  }
  return index;
}

absl::StatusOr<ShardIndex> BuildShardIndex(const fs::path& folder, const v1::Shard& shard) {
  const absl::StatusOr<std::string> sha256 = files::Sha256OfFile(folder / shard.file());
  if (!sha256.ok()) return sha256.status();
  if (*sha256 != shard.sha256()) {
    return absl::DataLossError(absl::StrCat("shard ", shard.file(), " has SHA-256 ", *sha256, "; ",
                                            kManifestFile, " says ", shard.sha256()));
  }
  ShardIndex index;
  const VisitPayload visit = [&index](const v1::Shard& visited, uint64_t offset,
                                      std::string&& payload, bool*) -> absl::Status {
    ScenarioName name;
    if (!name.ParseFromString(payload)) return NotAMessage(visited, offset, "a Scenario");
    AddToIndex(name.scenario_id(), offset, payload, &index);
    return absl::OkStatus();
  };
  absl::Status status = ForEachPayloadOfShard(folder, shard, visit);
  if (!status.ok()) return status;
  return index;
}

absl::Status WriteShardIndex(const fs::path& folder, const v1::Shard& shard, ShardIndex index) {
  index.set_format_version(kIndexFormatVersion);
  index.set_shard_sha256(shard.sha256());
  const std::string message = index.SerializeAsString();
  const uint32_t crc = MaskedCrc32c(message);
  std::string content(sizeof(crc), '\0');
  std::memcpy(content.data(), &crc, sizeof(crc));
  content += message;
  return files::WriteFileAtomically(IndexFileOf(folder, shard), content);
}

}  // namespace maneuver::data
