// Runs the trainer once for a job: to learn, or to measure a version.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_RUN_H_
#define MANEUVER_SERVER_JOBS_TRAINER_RUN_H_

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "maneuver/v1/training_service.pb.h"
#include "server/errors/error_details.h"
#include "server/jobs/child_process.h"
#include "server/jobs/job_environment.h"
#include "server/jobs/progress_recorder.h"

namespace maneuver::jobs {

// In a job's folder, or one of its own within.
inline constexpr char kSettingsFile[] = "settings.json";
inline constexpr char kLogFile[] = "trainer.log";
inline constexpr char kOutput[] = "output";

// How far a job is, of 1, that decides about promotion too: once the model is trained, and once the
// new version is measured.
inline constexpr double kTrainedAt = 0.9;
inline constexpr double kMeasuredAt = 0.95;

// One attempt at a job, for all processes of it. What it refers to must outlive it.
struct JobAttempt {
  const JobRunEnvironment& environment;
  StopRequest& stop;
  ProgressRecorder& progress;
  const std::function<absl::Time()>& now;
};

// What a job's process came to.
struct Outcome {
  absl::Status status;
  // For no reason of its own: another process is to go on.
  bool died = false;
};

// `status` without paths and with a reason: DISK_FULL if it says so, else `reason`.
absl::Status WithDefaultReason(absl::Status status, errors::Reason reason);

// Makes `folder` ready for a process: no output of a former one, and its settings.
absl::Status PrepareFolder(const std::filesystem::path& folder,
                           const google::protobuf::Message& settings);

// Runs the trainer with these arguments to its end, within the job's limits. OK if it says that all
// went well. Leaves the last lines of its log on the job.
Outcome RunTrainer(v1::Job& job, std::vector<std::string> arguments,
                   const std::filesystem::path& folder, const JobAttempt& attempt);

// What to measure.
struct MeasuringTask {
  std::string model;    // as EvaluateRequest.model
  std::string dataset;  // datasets/{dataset}
  v1::ExampleSettings examples;
  int sampled_examples = 0;
};

// Measures a version in `folder`, and keeps the report beside it. Without a report, the outcome or
// whoever asked to stop says why.
struct Measured {
  Outcome outcome;
  std::optional<v1::EvaluationReport> report;
};
Measured Measure(v1::Job& job, const MeasuringTask& task, const std::filesystem::path& folder,
                 const JobAttempt& attempt);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_TRAINER_RUN_H_
