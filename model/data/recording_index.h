// Random access to the recordings of a dataset folder.

#ifndef MANEUVER_MODEL_DATA_RECORDING_INDEX_H_
#define MANEUVER_MODEL_DATA_RECORDING_INDEX_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

// Knows where each recording of a folder is. Each shard has an index file beside it
// (".<shard>.index"). Takes about 100 bytes of memory a recording, whatever the recordings' size.
// Immutable; safe to use from any thread.
class RecordingIndex {
 public:
  struct Entry {
    std::string scenario_id;
    int shard = 0;  // index among the shards of scenarios
    uint64_t offset = 0;
    uint64_t payload_bytes = 0;
    uint32_t payload_crc = 0;  // masked CRC-32C
  };

  // Called with a sentence about each index that was damaged or stale and was rebuilt, naming it.
  using Report = std::function<void(const std::string& what)>;

  // Reads the index of each shard of scenarios. An index that is missing, damaged or stale is never
  // used: the shard is read and verified once, and its index is written anew, where the folder can
  // be written to. Errors: those of ReadDatasetManifest; DATA_LOSS for a damaged shard.
  static absl::StatusOr<RecordingIndex> Open(const std::filesystem::path& folder,
                                             const Report& report = {});
  // Reads the index of one shard of scenarios of the folder's manifest. DATA_LOSS for a damaged
  // shard; errors of files for one that cannot be read.
  static absl::StatusOr<RecordingIndex> OpenShard(const std::filesystem::path& folder,
                                                  const v1::Shard& shard,
                                                  const Report& report = {});

  // Returns all recordings, in the order of ForEachScenario.
  const std::vector<Entry>& entries() const { return entries_; }
  // Returns the number of the recording with this id, or -1.
  int64_t Find(const std::string& scenario_id) const;
  // Reads one recording from its place. DATA_LOSS, naming file and offset, if it is damaged or is
  // no longer the recording that was indexed.
  absl::StatusOr<v1::Scenario> Read(size_t recording) const;

 private:
  absl::Status Add(const v1::Shard& shard, const Report& report);

  std::filesystem::path folder_;
  std::vector<std::string> shards_;  // file names
  std::vector<Entry> entries_;
};

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_RECORDING_INDEX_H_
