#include "model/data/recording_blocks.h"

#include <utility>

#include "model/data/dataset_folder.h"

namespace maneuver::data {

absl::StatusOr<int64_t> RecordingBytes(const std::filesystem::path& folder) {
  const absl::StatusOr<v1::Dataset> manifest = ReadDatasetManifest(folder);
  if (!manifest.ok()) return manifest.status();
  int64_t bytes = 0;
  for (const v1::Shard& shard : manifest->shards()) {
    if (shard.content() == v1::SHARD_CONTENT_SCENARIOS) bytes += shard.size_bytes();
  }
  return bytes;
}

absl::StatusOr<RecordingBlocks> RecordingBlocks::Open(const std::filesystem::path& folder,
                                                      int64_t data_memory,
                                                      std::function<bool()> keep_going,
                                                      Wanted wanted) {
  const absl::StatusOr<v1::Dataset> manifest = ReadDatasetManifest(folder);
  if (!manifest.ok()) return manifest.status();
  const absl::StatusOr<int64_t> bytes = RecordingBytes(folder);
  if (!bytes.ok()) return bytes.status();
  RecordingBlocks blocks;
  blocks.folder_ = folder;
  blocks.recordings_ = manifest->recordings();
  blocks.keep_going_ = std::move(keep_going);
  blocks.wanted_ = wanted ? std::move(wanted) : [](const std::string&) { return true; };
  if (!FitInMemory(*bytes, data_memory)) {
    blocks.block_bytes_ = data_memory / kMemoryPerByte / 2;
    return blocks;
  }
  auto all = std::make_shared<std::vector<v1::Scenario>>();
  bool stopped = false;
  const absl::Status status = ForEachScenario(folder, OnDamage::kStop, [&](v1::Scenario&& each) {
    if (blocks.wanted_(each.scenario_id())) all->push_back(std::move(each));
    stopped = !blocks.keep_going_();
    return !stopped;
  });
  if (!status.ok()) return status;
  if (stopped) return absl::CancelledError("stopped while reading the recordings");
  blocks.kept_ = std::move(all);
  return blocks;
}

absl::Status RecordingBlocks::ForEach(const Visit& visit) const {
  return kept_ ? visit(*kept_) : Read(visit);
}

absl::Status RecordingBlocks::Read(const Visit& visit) const {
  std::vector<v1::Scenario> block;
  int64_t bytes = 0;
  absl::Status visited;
  const auto end_block = [&] {
    visited = visit(block);
    block.clear();
    bytes = 0;
  };
  const absl::Status read =
      ForEachScenario(folder_, OnDamage::kStop, [&](v1::Scenario&& recording) {
        if (!keep_going_()) {
          visited = absl::CancelledError("stopped while reading the recordings");
          return false;
        }
        if (!wanted_(recording.scenario_id())) return true;
        const auto size = static_cast<int64_t>(recording.ByteSizeLong());
        if (!block.empty() && bytes + size > block_bytes_) end_block();
        block.push_back(std::move(recording));
        bytes += size;
        return visited.ok();
      });
  if (!read.ok()) return read;
  if (visited.ok() && !block.empty()) end_block();
  return visited;
}

}  // namespace maneuver::data
