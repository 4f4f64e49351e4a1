// Checkpoints of a training run on disk.

#ifndef MANEUVER_MODEL_LEARNING_CHECKPOINT_H_
#define MANEUVER_MODEL_LEARNING_CHECKPOINT_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "checkpoint.pb.h"
#include "model/learning/checkpoint_policy.h"

namespace maneuver::learning {

// A folder with the latest checkpoints of one run, such as "checkpoint-000007". Their numbers only
// grow. Each is written completely or not at all, and carries a checksum.
class CheckpointFolder {
 public:
  // Opens the folder, and creates it if it is missing. Removes what an interrupted Write left.
  // The error (errno_status.h) of a folder that cannot be created or a file that cannot be removed.
  static absl::StatusOr<CheckpointFolder> Open(const std::filesystem::path& folder,
                                               const CheckpointPolicy& policy);

  // Returns the latest undamaged checkpoint; nothing if there is none.
  std::optional<Checkpoint> ReadLatest() const;

  // Counts a step. Call it before each step, and before Write.
  void CountStep() { ++steps_; }
  // Returns whether the interval, or the number of steps, has passed since the last checkpoint (or
  // since the folder was opened).
  bool IsDue() const;
  // Writes a checkpoint and removes all but the last `kept`. RESOURCE_EXHAUSTED if it is larger than
  // 2 GiB. Other errors: those of files::WriteFileAtomically.
  absl::Status Write(const Checkpoint& checkpoint);

 private:
  CheckpointFolder(std::filesystem::path folder, const CheckpointPolicy& policy);

  std::filesystem::path folder_;
  CheckpointPolicy policy_;
  int64_t steps_ = 0;  // since the last one
  std::chrono::steady_clock::time_point last_;
  int64_t next_ = 1;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_CHECKPOINT_H_
