// One job from its start to its end: its folder, its trainer process, and what came of it.

#ifndef MANEUVER_SERVER_JOBS_JOB_RUN_H_
#define MANEUVER_SERVER_JOBS_JOB_RUN_H_

#include <chrono>
#include <filesystem>
#include <functional>
#include <string>

#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"
#include "model/data/dataset_store.h"
#include "server/jobs/child_process.h"
#include "server/jobs/progress_recorder.h"

namespace maneuver::jobs {

// Makes a finished model folder the next version of models/{model_id} and returns the version's
// name. It takes the folder away, or leaves it and all else as it was. May take long.
using PublishModel = std::function<absl::StatusOr<std::string>(
    const std::string& model_id, const std::filesystem::path& finished, v1::Promotion promotion)>;

// The version that EvaluateRequest.model means.
struct ResolvedModel {
  std::string version;  // models/{model}/versions/{version}
  std::filesystem::path folder;
};
using ResolveModel = std::function<absl::StatusOr<ResolvedModel>(const std::string& reference)>;

// Where a job finds what it needs. What it points to must live as long as the run.
struct JobRunEnvironment {
  std::string trainer;      // program
  int trainer_threads = 0;  // of each run, whatever its settings say; 0: as they say
  const data::DatasetStore* datasets = nullptr;
  PublishModel publish;
  ResolveModel resolve;
  std::chrono::milliseconds patience{5'000};  // from SIGTERM to SIGKILL
};

// Runs `job` in `folder` and returns it in one of the states that end it, with all that goes with
// it but its end_time. Writes in `folder`:
//   settings.json   what the trainer was told
//   trainer.log     its standard error
//   output          its result, until it is published or read
v1::Job RunJob(v1::Job job, const std::filesystem::path& folder,
               const JobRunEnvironment& environment, StopRequest& stop, ProgressRecorder& progress);

// Removes from a job's folder what its trainer made but nobody wants.
void RemoveJobOutput(const std::filesystem::path& folder);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_RUN_H_
