#include "server/jobs/job_run.h"

#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "model/artifact/training_presets.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "server/errors/error_details.h"
#include "server/jobs/job_requests.h"
#include "server/jobs/job_time.h"
#include "server/jobs/trainer_outcome.h"

namespace maneuver::jobs {
namespace {

namespace fs = std::filesystem;

constexpr char kSettingsFile[] = "settings.json";
constexpr char kLogFile[] = "trainer.log";
constexpr char kOutput[] = "output";

std::string ToJson(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  std::string json;
  // Fails only for messages that no request can hold (Any).
  (void)google::protobuf::util::MessageToJsonString(message, &json, options);
  return json;
}

absl::Status WithDefaultReason(absl::Status status, errors::Reason reason) {
  absl::Status clean(status.code(), WithoutPaths(std::string(status.message())));
  return errors::WithReason(
      std::move(clean), absl::IsResourceExhausted(status) ? errors::Reason("DISK_FULL") : reason);
}

absl::Status PrepareFolder(const fs::path& folder, const google::protobuf::Message& settings) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return files::ErrnoStatus(error.value(), "create", folder);
  RemoveJobOutput(folder);
  return files::WriteFileAtomically(folder / kSettingsFile, ToJson(settings) + "\n");
}

// What a job's process came to.
struct Outcome {
  absl::Status status;
  // For no reason of its own: another process is to go on.
  bool died = false;
};

// The rest of what the job's processes may take; nothing left: 0 or less. Nothing: no limit.
std::optional<std::chrono::milliseconds> TimeLeft(const v1::Job& job, const JobLimits& limits) {
  if (limits.run_time.count() == 0) return std::nullopt;
  return limits.run_time -
         absl::ToChronoMilliseconds(ToDuration(job.attempts().earlier_run_time()));
}

// Runs the trainer to its end. OK if it says that all went well.
Outcome RunTrainer(v1::Job& job, std::vector<std::string> arguments, const fs::path& folder,
                   const JobRunEnvironment& environment, StopRequest& stop,
                   ProgressRecorder& progress) {
  const JobLimits& limits = environment.limits;
  ChildCommand command;
  command.arguments = {environment.trainer};
  command.arguments.insert(command.arguments.end(), arguments.begin(), arguments.end());
  if (limits.threads > 0) {
    command.arguments.insert(command.arguments.end(),
                             {"--threads", std::to_string(limits.threads)});
  }
  command.log = folder / kLogFile;
  command.patience = environment.patience;
  command.memory_limit_bytes = limits.memory_bytes;
  if (const auto left = TimeLeft(job, limits)) {
    if (left->count() <= 0) return {WallTimeExceeded(limits.run_time)};
    command.time_limit = *left;
  }
  std::error_code error;
  const auto log_size = fs::file_size(command.log, error);
  const auto result = RunChild(
      command, stop, [&](const std::string& line) { progress.Record(line); },
      [&] { progress.Tick(); });
  progress.Flush();
  if (!result.ok()) return {CannotStartTrainer(result.status())};
  const std::vector<std::string> lines =
      LastLines(command.log, error ? 0 : static_cast<int64_t>(log_size));
  job.mutable_last_lines()->Assign(lines.begin(), lines.end());
  const bool is_done = result->signal == 0 && result->exit_status == 0;
  if (result->timed_out && !is_done) return {WallTimeExceeded(limits.run_time)};
  return {TrainerStatus(*result, lines.empty() ? std::string() : lines.back()), HasDied(*result)};
}

std::vector<std::string> TrainArguments(const v1::Job& job, const fs::path& folder,
                                        const JobRunEnvironment& environment) {
  const CheckpointOptions& checkpoints = environment.checkpoints;
  const double interval = std::chrono::duration<double>(checkpoints.interval).count();
  std::vector<std::string> arguments = {"train",
                                        "--settings",
                                        folder / kSettingsFile,
                                        "--output",
                                        folder / kOutput,
                                        "--progress",
                                        "json",
                                        "--checkpoints",
                                        CheckpointFolder(folder),
                                        "--checkpoint-interval",
                                        absl::StrCat(interval),
                                        "--checkpoint-steps",
                                        absl::StrCat(checkpoints.steps),
                                        "--checkpoints-kept",
                                        absl::StrCat(checkpoints.kept),
                                        "--least-actions",
                                        absl::StrCat(environment.least_effective_actions)};
  for (const std::string& dataset : job.train().datasets()) {
    const std::string id(absl::StripPrefix(dataset, "datasets/"));
    arguments.insert(arguments.end(),
                     {"--dataset", environment.datasets->FolderOf(id), "--dataset-name", dataset});
  }
  return arguments;
}

Outcome Train(v1::Job& job, const fs::path& folder, const JobRunEnvironment& environment,
              StopRequest& stop, ProgressRecorder& progress) {
  const v1::TrainRequest& request = job.train();
  if (absl::Status status =
          PrepareFolder(folder, artifact::ResolveTrainingSettings(request.settings()));
      !status.ok()) {
    return {WithDefaultReason(status, "CANNOT_WRITE")};
  }
  Outcome outcome = RunTrainer(job, TrainArguments(job, folder, environment), folder, environment,
                               stop, progress);
  if (!outcome.status.ok() || stop.reason() != StopRequest::Reason::kNone) return outcome;
  const auto version =
      environment.publish(std::string(absl::StripPrefix(request.model(), "models/")),
                          folder / kOutput, request.promotion(), job.name());
  if (!version.ok()) return {WithDefaultReason(version.status(), "MODEL_REFUSED")};
  job.set_model_version(*version);
  return outcome;
}

Outcome Evaluate(v1::Job& job, const fs::path& folder, const JobRunEnvironment& environment,
                 StopRequest& stop, ProgressRecorder& progress) {
  const v1::EvaluateRequest& request = job.evaluate();
  const auto model = environment.resolve(request.model());
  if (!model.ok()) return {WithDefaultReason(model.status(), "MODEL_UNAVAILABLE")};
  if (absl::Status status = PrepareFolder(folder, ResolveExamples(request.examples()));
      !status.ok()) {
    return {WithDefaultReason(status, "CANNOT_WRITE")};
  }
  const std::string id(absl::StripPrefix(request.dataset(), "datasets/"));
  Outcome outcome = RunTrainer(
      job,
      {"evaluate", "--model", model->folder, "--dataset", environment.datasets->FolderOf(id),
       "--settings", folder / kSettingsFile, "--output", folder / kOutput, "--sampled-examples",
       std::to_string(request.sampled_examples()), "--progress", "json"},
      folder, environment, stop, progress);
  if (!outcome.status.ok() || stop.reason() != StopRequest::Reason::kNone) return outcome;
  const auto text = files::ReadFile(folder / kOutput);
  v1::EvaluationReport report;
  if (!text.ok() || !google::protobuf::util::JsonStringToMessage(*text, &report).ok()) {
    return {errors::WithReason(absl::InternalError("the trainer ended well but left no report"),
                               "TRAINER_INTERNAL")};
  }
  report.set_model_version(model->version);
  report.set_dataset(request.dataset());
  *job.mutable_evaluation() = std::move(report);
  return outcome;
}

}  // namespace

void RemoveJobOutput(const fs::path& folder) {
  std::error_code ignored;
  fs::remove_all(folder / kOutput, ignored);
  files::RemoveTemporaries(folder).IgnoreError();
  files::RemoveTemporaries(CheckpointFolder(folder)).IgnoreError();
}

void BeginAttempt(v1::Job& job, const fs::path& folder, absl::Time now) {
  v1::JobAttempts& attempts = *job.mutable_attempts();
  attempts.set_started(attempts.started() + 1);
  *attempts.mutable_start_time() = ToTimestamp(now);
  attempts.set_checkpoint(LastCheckpoint(folder));
  if (!job.has_start_time()) *job.mutable_start_time() = ToTimestamp(now);
}

void EndAttempt(v1::Job& job, const fs::path& folder, absl::Time end, bool died) {
  v1::JobAttempts& attempts = *job.mutable_attempts();
  const absl::Duration ran = std::max(absl::ZeroDuration(), end - ToTime(attempts.start_time()));
  *attempts.mutable_earlier_run_time() = ToProto(ToDuration(attempts.earlier_run_time()) + ran);
  if (LastCheckpoint(folder) > attempts.checkpoint()) {
    attempts.set_without_progress(0);
  } else if (died) {
    attempts.set_without_progress(attempts.without_progress() + 1);
  }
}

v1::Job RunJob(v1::Job job, const fs::path& folder, const JobRunEnvironment& environment,
               StopRequest& stop, ProgressRecorder& progress,
               const std::function<absl::Time()>& now) {
  const int most = environment.limits.attempts_without_progress;
  Outcome outcome;
  // The server may have died after it published the version and before it said so.
  if (job.has_train() && job.attempts().started() > 1) {
    const auto published =
        environment.find_published(std::string(absl::StripPrefix(job.train().model(), "models/")),
                                   job.train().promotion(), job.name());
    if (!published.ok()) {
      outcome.status = WithDefaultReason(published.status(), "MODEL_REFUSED");
    } else if (*published) {
      job.set_model_version(**published);
    }
  }
  if (outcome.status.ok() && job.model_version().empty()) {
    if (job.attempts().without_progress() >= most) {
      outcome.status = GaveUp(errors::FromProto(job.error()), most);
    } else if (stop.reason() == StopRequest::Reason::kNone) {
      outcome = job.has_train() ? Train(job, folder, environment, stop, progress)
                                : Evaluate(job, folder, environment, stop, progress);
    }
  }
  RemoveJobOutput(folder);
  EndAttempt(job, folder, now(), outcome.died && stop.reason() == StopRequest::Reason::kNone);
  job.clear_error();
  const bool made_something = job.has_evaluation() || !job.model_version().empty();
  // Whoever asked to stop too late gets what was finished.
  if (made_something) {
    job.set_state(v1::JOB_STATE_SUCCEEDED);
    RemoveCheckpoints(folder);
  } else if (stop.reason() == StopRequest::Reason::kCancelled) {
    job.set_state(v1::JOB_STATE_CANCELLED);
  } else if (stop.reason() == StopRequest::Reason::kServerStops) {
    job.set_state(v1::JOB_STATE_PENDING);
    *job.mutable_error() = errors::ToProto(ServerInterrupted());
  } else if (outcome.died && job.attempts().without_progress() < most) {
    job.set_state(v1::JOB_STATE_PENDING);
    *job.mutable_error() = errors::ToProto(outcome.status);
  } else {
    if (outcome.died) outcome.status = GaveUp(std::move(outcome.status), most);
    job.set_state(v1::JOB_STATE_FAILED);
    *job.mutable_error() = errors::ToProto(outcome.status);
  }
  if (!job.has_error()) job.clear_last_lines();
  return job;
}

}  // namespace maneuver::jobs
