// What a job uses of the server: its models, its datasets, and how much of the machine.

#ifndef MANEUVER_SERVER_JOBS_JOB_ENVIRONMENT_H_
#define MANEUVER_SERVER_JOBS_JOB_ENVIRONMENT_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <string>

#include "model/data/dataset_store.h"
#include "server/jobs/checkpoints.h"
#include "server/serving/model_versions.h"

namespace maneuver::jobs {

// What a job may use.
struct JobLimits {
  int threads = 0;           // of each process, whatever its settings say; 0: as they say
  int64_t memory_bytes = 0;  // of each process, as ChildCommand has it; 0: no limit
  // All processes of a job together, since it was made or resumed by request; 0: no limit.
  std::chrono::milliseconds run_time{0};
  // So many processes in a row may die without a new checkpoint.
  int attempts_without_progress = 5;
};

// Where a job finds what it needs. What it points to must live as long as the run.
struct JobRunEnvironment {
  std::string trainer;  // program
  JobLimits limits;
  CheckpointOptions checkpoints;
  // A model of fewer effective actions fails its job.
  int least_effective_actions = 0;
  const data::DatasetStore* datasets = nullptr;
  serving::ModelVersions* versions = nullptr;
  std::chrono::milliseconds patience{5'000};  // from SIGTERM to SIGKILL
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_ENVIRONMENT_H_
