// The command-line options about jobs.

#ifndef MANEUVER_SERVER_MANEUVERD_JOB_OPTIONS_H_
#define MANEUVER_SERVER_MANEUVERD_JOB_OPTIONS_H_

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <string>

#include "server/jobs/checkpoints.h"
#include "server/jobs/job_environment.h"
#include "server/jobs/retention.h"

namespace maneuver {

struct JobOptions {
  std::filesystem::path trainer;  // the program
  std::string trainer_command;    // starts it for a training job: JobRunEnvironment::launcher
  int max_running = 1;
  int ranks = 0;       // of a job, at most; 0: as many as the machine has cores
  int64_t memory = 0;  // of a job, at most, bytes; 0: an equal share of the machine's
  int max_pending = 1'000;
  jobs::JobLimits limits;
  jobs::CheckpointOptions checkpoints;
  int least_effective_actions = 2;
  jobs::RetentionPolicy retention;
  int64_t tag_quota_bytes = 0;  // of all tags together; 0: no limit
};

// Adds the flags that set `options`. Parsing the command line writes to `options`, so it must live
// until then.
void AddJobOptions(CLI::App& app, JobOptions& options);

// Returns the most ranks and the most bytes of a job: what is set, or what this machine has. With a
// trainer_command other machines run the ranks, and only what is set counts.
int64_t RanksForAJob(const JobOptions& options);
int64_t MemoryForAJob(const JobOptions& options);

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_JOB_OPTIONS_H_
