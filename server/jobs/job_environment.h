// What jobs use of the server: its models, its datasets, and how much of the machine.

#ifndef MANEUVER_SERVER_JOBS_JOB_ENVIRONMENT_H_
#define MANEUVER_SERVER_JOBS_JOB_ENVIRONMENT_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"
#include "model/data/dataset_store.h"
#include "server/jobs/checkpoints.h"

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

// What a job reads and changes of versions, besides publishing one. Versions are named as
// models/{model}/versions/{version}. May take long.
struct VersionAccess {
  // Keeps a report beside the version that it names, in place of one on the same dataset. NOT_FOUND
  // if the version is gone.
  std::function<absl::Status(const v1::EvaluationReport& report)> keep_report;
  // The report of a version on datasets/{dataset}. NOT_FOUND if there is none.
  std::function<absl::StatusOr<v1::EvaluationReport>(const std::string& version,
                                                     const std::string& dataset)>
      find_report;
  // The version that serves models/{model_id}; empty: none does.
  std::function<std::string(const std::string& model_id)> serving;
  // Makes a version serve as long as `before` does (empty: none). False, and nothing is changed, if
  // another one does by now.
  std::function<absl::StatusOr<bool>(const std::string& version, const std::string& before)>
      promote_over;
};

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
  VersionAccess versions;
  std::chrono::milliseconds patience{5'000};  // from SIGTERM to SIGKILL
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_ENVIRONMENT_H_
