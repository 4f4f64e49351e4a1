// The checkpoints that a trainer keeps for its job, as the server sees them: see
// trainer_protocol.h.

#ifndef MANEUVER_SERVER_JOBS_CHECKPOINTS_H_
#define MANEUVER_SERVER_JOBS_CHECKPOINTS_H_

#include <chrono>
#include <cstdint>
#include <filesystem>

namespace maneuver::jobs {

// What trainers are told of them.
struct CheckpointOptions {
  // Least time between two; 0: one at every step.
  std::chrono::milliseconds interval{60'000};
  // One after so many steps as well, however short the time; 0: by time alone.
  int64_t steps = 0;
  // The last so many are kept.
  int kept = 2;
};

// Of the job with this folder.
std::filesystem::path CheckpointFolder(const std::filesystem::path& job_folder);
// The number of its last checkpoint; 0: none. A job has got further when it has grown.
int64_t LastCheckpoint(const std::filesystem::path& job_folder);
// Removes all of them. Whether there were any.
bool RemoveCheckpoints(const std::filesystem::path& job_folder);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_CHECKPOINTS_H_
