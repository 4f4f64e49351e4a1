#include "server/jobs/job_run.h"

#include <google/protobuf/util/json_util.h>

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

absl::Status WithDefaultReason(absl::Status status, const char* reason) {
  absl::Status clean(status.code(), WithoutPaths(std::string(status.message())));
  return errors::WithReason(std::move(clean),
                            absl::IsResourceExhausted(status) ? "CANNOT_WRITE" : reason);
}

absl::Status PrepareFolder(const fs::path& folder, const google::protobuf::Message& settings) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return files::ErrnoStatus(error.value(), "create", folder);
  RemoveJobOutput(folder);
  return files::WriteFileAtomically(folder / kSettingsFile, ToJson(settings) + "\n");
}

// Runs the trainer to its end. OK if it says that all went well.
absl::Status RunTrainer(std::vector<std::string> arguments, const fs::path& folder,
                        const JobRunEnvironment& environment, StopRequest& stop,
                        ProgressRecorder& progress) {
  ChildCommand command;
  command.arguments = {environment.trainer};
  command.arguments.insert(command.arguments.end(), arguments.begin(), arguments.end());
  if (environment.trainer_threads > 0) {
    command.arguments.insert(command.arguments.end(),
                             {"--threads", std::to_string(environment.trainer_threads)});
  }
  command.log = folder / kLogFile;
  command.patience = environment.patience;
  const auto result = RunChild(
      command, stop, [&](const std::string& line) { progress.Record(line); },
      [&] { progress.Tick(); });
  progress.Flush();
  if (!result.ok()) return CannotStartTrainer(result.status());
  return TrainerStatus(*result, LastLine(command.log));
}

absl::Status Train(v1::Job& job, const fs::path& folder, const JobRunEnvironment& environment,
                   StopRequest& stop, ProgressRecorder& progress) {
  const v1::TrainRequest& request = job.train();
  if (absl::Status status =
          PrepareFolder(folder, artifact::ResolveTrainingSettings(request.settings()));
      !status.ok()) {
    return WithDefaultReason(status, "CANNOT_WRITE");
  }
  std::vector<std::string> arguments = {"train",    "--settings",     folder / kSettingsFile,
                                        "--output", folder / kOutput, "--progress",
                                        "json"};
  for (const std::string& dataset : request.datasets()) {
    const std::string id(absl::StripPrefix(dataset, "datasets/"));
    arguments.insert(arguments.end(),
                     {"--dataset", environment.datasets->FolderOf(id), "--dataset-name", dataset});
  }
  absl::Status status = RunTrainer(std::move(arguments), folder, environment, stop, progress);
  if (!status.ok() || stop.reason() != StopRequest::Reason::kNone) return status;
  const auto version =
      environment.publish(std::string(absl::StripPrefix(request.model(), "models/")),
                          folder / kOutput, request.promotion());
  if (!version.ok()) return WithDefaultReason(version.status(), "MODEL_REFUSED");
  job.set_model_version(*version);
  return absl::OkStatus();
}

absl::Status Evaluate(v1::Job& job, const fs::path& folder, const JobRunEnvironment& environment,
                      StopRequest& stop, ProgressRecorder& progress) {
  const v1::EvaluateRequest& request = job.evaluate();
  const auto model = environment.resolve(request.model());
  if (!model.ok()) return WithDefaultReason(model.status(), "MODEL_UNAVAILABLE");
  if (absl::Status status = PrepareFolder(folder, ResolveExamples(request.examples()));
      !status.ok()) {
    return WithDefaultReason(status, "CANNOT_WRITE");
  }
  const std::string id(absl::StripPrefix(request.dataset(), "datasets/"));
  absl::Status status = RunTrainer(
      {"evaluate", "--model", model->folder, "--dataset", environment.datasets->FolderOf(id),
       "--settings", folder / kSettingsFile, "--output", folder / kOutput, "--sampled-examples",
       std::to_string(request.sampled_examples()), "--progress", "json"},
      folder, environment, stop, progress);
  if (!status.ok() || stop.reason() != StopRequest::Reason::kNone) return status;
  const auto text = files::ReadFile(folder / kOutput);
  v1::EvaluationReport report;
  if (!text.ok() || !google::protobuf::util::JsonStringToMessage(*text, &report).ok()) {
    return errors::WithReason(absl::InternalError("the trainer ended well but left no report"),
                              "TRAINER_INTERNAL");
  }
  report.set_model_version(model->version);
  report.set_dataset(request.dataset());
  *job.mutable_evaluation() = std::move(report);
  return absl::OkStatus();
}

}  // namespace

void RemoveJobOutput(const fs::path& folder) {
  std::error_code ignored;
  fs::remove_all(folder / kOutput, ignored);
  files::RemoveTemporaries(folder).IgnoreError();
}

v1::Job RunJob(v1::Job job, const fs::path& folder, const JobRunEnvironment& environment,
               StopRequest& stop, ProgressRecorder& progress) {
  absl::Status status = absl::OkStatus();
  if (stop.reason() == StopRequest::Reason::kNone) {
    status = job.has_train() ? Train(job, folder, environment, stop, progress)
                             : Evaluate(job, folder, environment, stop, progress);
  }
  RemoveJobOutput(folder);
  const bool made_something = job.has_evaluation() || !job.model_version().empty();
  // Whoever asked to stop too late gets what was finished.
  if (made_something) {
    job.set_state(v1::JOB_STATE_SUCCEEDED);
  } else if (stop.reason() == StopRequest::Reason::kCancelled) {
    job.set_state(v1::JOB_STATE_CANCELLED);
  } else {
    if (stop.reason() == StopRequest::Reason::kServerStops) status = ServerInterrupted();
    job.set_state(v1::JOB_STATE_FAILED);
    *job.mutable_error() = errors::ToProto(status);
  }
  return job;
}

}  // namespace maneuver::jobs
