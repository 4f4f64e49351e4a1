// The checkpoints that a trainer keeps for its job, as the server sees them: see
// trainer_protocol.h.

#ifndef MANEUVER_SERVER_JOBS_CHECKPOINTS_H_
#define MANEUVER_SERVER_JOBS_CHECKPOINTS_H_

#include <chrono>
#include <cstdint>
#include <filesystem>

namespace maneuver::jobs {

// When a trainer writes checkpoints, and how many it keeps.
struct CheckpointOptions {
  // The least time between two checkpoints; 0: a checkpoint at every step.
  std::chrono::milliseconds interval{60'000};
  // A checkpoint is also written this many steps after the last one, even before `interval` has
  // passed; 0: only `interval` counts.
  int64_t steps = 0;
  // Number of checkpoints that are kept, the newest ones.
  int kept = 2;
};

// Returns the checkpoint folder of the job in `job_folder`.
std::filesystem::path CheckpointFolder(const std::filesystem::path& job_folder);
// Returns the number of the job's last checkpoint, or 0 if it has none. A job makes progress while
// this number grows.
int64_t LastCheckpoint(const std::filesystem::path& job_folder);
// Removes all checkpoints of a job. Returns whether there were any.
bool RemoveCheckpoints(const std::filesystem::path& job_folder);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_CHECKPOINTS_H_
