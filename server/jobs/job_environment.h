// What a job uses of the server: its models, its datasets, and its share of the machine.

#ifndef MANEUVER_SERVER_JOBS_JOB_ENVIRONMENT_H_
#define MANEUVER_SERVER_JOBS_JOB_ENVIRONMENT_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "model/data/dataset_store.h"
#include "model/data/recording_blocks.h"
#include "model/tags/tag_store.h"
#include "server/jobs/checkpoints.h"
#include "server/serving/model_versions.h"

namespace maneuver::jobs {

// Limits on what a job may use.
struct JobLimits {
  int threads = 0;           // of each process; 0: as its settings say
  int64_t memory_bytes = 0;  // of each process, see ChildCommand; 0: no limit
  // Memory that recordings may take in a process which trains or evaluates, bytes. Larger data are
  // read piece by piece.
  int64_t data_memory = data::kDefaultDataMemory;
  // Total run time of a job's processes since the job was created or resumed by request; 0: no
  // limit.
  std::chrono::milliseconds run_time{0};
  // A job fails once this many processes in a row have died without a new checkpoint.
  int attempts_without_progress = 5;
};

// Where a job finds what it needs. Everything that it points to must outlive the run.
struct JobRunEnvironment {
  std::string trainer;  // the program
  // Command that starts the trainer of a training job, such as {"srun", "-n{ranks}"}: a program and
  // its first arguments, before the trainer's own. {ranks} stands for the job's number of ranks.
  // Empty: the trainer starts its ranks itself.
  std::vector<std::string> launcher;
  JobLimits limits;
  CheckpointOptions checkpoints;
  // A job whose model has fewer effective actions fails.
  int least_effective_actions = 0;
  const data::DatasetStore* datasets = nullptr;
  const tags::TagStore* tag_store = nullptr;
  serving::ModelVersions* versions = nullptr;
  std::chrono::milliseconds patience{5'000};  // from SIGTERM to SIGKILL
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_ENVIRONMENT_H_
