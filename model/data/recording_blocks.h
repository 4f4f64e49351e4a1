// The recordings of a dataset folder, block by block, in bounded memory.

#ifndef MANEUVER_MODEL_DATA_RECORDING_BLOCKS_H_
#define MANEUVER_MODEL_DATA_RECORDING_BLOCKS_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

// Memory that recordings may take, bytes, unless somebody says otherwise.
inline constexpr int64_t kDefaultDataMemory = int64_t{2} << 30;

// Bytes of memory that a byte of a recording on disk takes, about, once it is parsed and its map is
// indexed. Measured: 4 to 5.
inline constexpr int64_t kMemoryPerByte = 5;

// Returns the bytes that the recordings of a folder take on disk, by its manifest. Errors: those of
// ReadDatasetManifest.
absl::StatusOr<int64_t> RecordingBytes(const std::filesystem::path& folder);

// Returns whether recordings that take `bytes` on disk fit in `data_memory` bytes of memory.
constexpr bool FitInMemory(int64_t bytes, int64_t data_memory) {
  return bytes <= data_memory / kMemoryPerByte;
}

// The recordings of a folder, in the order of ForEachScenario. If the whole folder fits in the
// memory that they may take, they are read once and stay, as one block. Otherwise each pass reads
// them anew, in blocks that take at most half of that memory, or a single recording. Safe to use
// from any thread.
class RecordingBlocks {
 public:
  // Called with a block, which it may use until it returns. An error ends the pass.
  using Visit = std::function<absl::Status(std::span<const v1::Scenario> block)>;
  // Says whether a recording is wanted.
  using Wanted = std::function<bool(const std::string& scenario_id)>;

  //   data_memory: bytes
  //   keep_going: asked between recordings, never empty; false ends Open or ForEach with CANCELLED
  //   wanted: blocks hold these recordings alone; empty: all
  // Errors: those of ForEachScenario, which stops at damage.
  static absl::StatusOr<RecordingBlocks> Open(const std::filesystem::path& folder,
                                              int64_t data_memory, std::function<bool()> keep_going,
                                              Wanted wanted = {});

  // Calls `visit` with each block, in order. Errors: those of `visit` and of ForEachScenario.
  absl::Status ForEach(const Visit& visit) const;

  // Returns the number of recordings of the folder.
  int64_t recordings() const { return recordings_; }

 private:
  absl::Status Read(const Visit& visit) const;

  std::filesystem::path folder_;
  int64_t block_bytes_ = 0;  // on disk
  int64_t recordings_ = 0;
  std::function<bool()> keep_going_;
  Wanted wanted_;                                          // never empty
  std::shared_ptr<const std::vector<v1::Scenario>> kept_;  // null if they do not fit
};

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_RECORDING_BLOCKS_H_
