// One process of a job from its start to its end: its folder, its trainer, and what came of it.

#ifndef MANEUVER_SERVER_JOBS_JOB_RUN_H_
#define MANEUVER_SERVER_JOBS_JOB_RUN_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "maneuver/v1/training_service.pb.h"
#include "model/data/dataset_store.h"
#include "server/jobs/checkpoints.h"
#include "server/jobs/child_process.h"
#include "server/jobs/progress_recorder.h"

namespace maneuver::jobs {

// Makes a finished model folder, which the job `maker` made, the next version of models/{model_id}
// and returns the version's name. It takes the folder away, or leaves it and all else as it was.
// May take long.
using PublishModel = std::function<absl::StatusOr<std::string>(
    const std::string& model_id, const std::filesystem::path& finished, v1::Promotion promotion,
    const std::string& maker)>;

// The version of models/{model_id} that the job `maker` made before the server died, if it came so
// far, promoted as it was to be. May take long.
using FindPublished = std::function<absl::StatusOr<std::optional<std::string>>(
    const std::string& model_id, v1::Promotion promotion, const std::string& maker)>;

// The version that EvaluateRequest.model means.
struct ResolvedModel {
  std::string version;  // models/{model}/versions/{version}
  std::filesystem::path folder;
};
using ResolveModel = std::function<absl::StatusOr<ResolvedModel>(const std::string& reference)>;

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
  PublishModel publish;
  FindPublished find_published;
  ResolveModel resolve;
  std::chrono::milliseconds patience{5'000};  // from SIGTERM to SIGKILL
};

// Counts a process of the job that is to start now.
void BeginAttempt(v1::Job& job, const std::filesystem::path& folder, absl::Time now);
// Counts the end of that process, at `end`.
//   died: it is to be held against the job if it left no new checkpoint.
void EndAttempt(v1::Job& job, const std::filesystem::path& folder, absl::Time end, bool died);

// Runs one process of `job`, which BeginAttempt counted, in `folder`. Returns the job with all that
// goes with its new state but its end_time: in one of the states that end it, or PENDING if another
// process is to go on. Writes in `folder`:
//   settings.json   what the trainer was told
//   trainer.log     its standard error
//   checkpoints     where the next process goes on from; removed once the job has SUCCEEDED
//   output          its result, until it is published or read
v1::Job RunJob(v1::Job job, const std::filesystem::path& folder,
               const JobRunEnvironment& environment, StopRequest& stop, ProgressRecorder& progress,
               const std::function<absl::Time()>& now);

// Removes from a job's folder what its trainer made but nobody wants.
void RemoveJobOutput(const std::filesystem::path& folder);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_RUN_H_
