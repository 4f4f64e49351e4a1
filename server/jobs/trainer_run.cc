#include "server/jobs/trainer_run.h"

#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <optional>
#include <system_error>
#include <utility>

#include "absl/strings/strip.h"
#include "model/data/dataset_folder.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "server/jobs/job_requests.h"
#include "server/jobs/job_run.h"
#include "server/jobs/job_time.h"
#include "server/jobs/trainer_outcome.h"
#include "server/monitoring/logging.h"

namespace maneuver::jobs {
namespace {

namespace fs = std::filesystem;

std::string ToJson(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  std::string json;
  // Fails only for messages that no request can hold (Any).
  (void)google::protobuf::util::MessageToJsonString(message, &json, options);
  return json;
}

// The rest of what the job's processes may take; nothing left: 0 or less. Nothing: no limit.
std::optional<std::chrono::milliseconds> TimeLeft(const v1::Job& job, const JobLimits& limits,
                                                  absl::Time now) {
  if (limits.run_time.count() == 0) return std::nullopt;
  // An attempt may have several processes, one after another.
  const absl::Duration ran =
      ToDuration(job.attempts().earlier_run_time()) +
      std::max(absl::ZeroDuration(), now - ToTime(job.attempts().start_time()));
  return limits.run_time - absl::ToChronoMilliseconds(ran);
}

// What the trainer found, as it is kept: complete.
absl::StatusOr<v1::EvaluationReport> ReadReport(const fs::path& output,
                                                const security::ModelVersionName& version,
                                                const v1::Dataset& dataset,
                                                const MeasuringTask& task, absl::Time now) {
  const auto text = files::ReadFile(output);
  v1::EvaluationReport report;
  if (!text.ok() || !google::protobuf::util::JsonStringToMessage(*text, &report).ok()) {
    return errors::WithReason(absl::InternalError("the trainer ended well but left no report"),
                              "TRAINER_INTERNAL");
  }
  report.set_model_version(version.ToString());
  report.set_dataset(task.dataset);
  report.set_dataset_sha256(data::ContentSha256(dataset));
  *report.mutable_create_time() = ToTimestamp(now);
  return report;
}

}  // namespace

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

Outcome RunTrainer(v1::Job& job, std::vector<std::string> arguments, const fs::path& folder,
                   const JobAttempt& attempt) {
  const JobRunEnvironment& environment = attempt.environment;
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
  if (const auto left = TimeLeft(job, limits, attempt.now())) {
    if (left->count() <= 0) return {WallTimeExceeded(limits.run_time)};
    command.time_limit = *left;
  }
  std::error_code error;
  const auto log_size = fs::file_size(command.log, error);
  const auto result = RunChild(
      command, attempt.stop, [&](const std::string& line) { attempt.progress.Record(line); },
      [&] { attempt.progress.Tick(); });
  attempt.progress.Flush();
  if (!result.ok()) return {CannotStartTrainer(result.status())};
  const std::vector<std::string> lines =
      LastLines(command.log, error ? 0 : static_cast<int64_t>(log_size));
  job.mutable_last_lines()->Assign(lines.begin(), lines.end());
  const bool is_done = result->signal == 0 && result->exit_status == 0;
  if (result->timed_out && !is_done) return {WallTimeExceeded(limits.run_time)};
  return {TrainerStatus(*result, lines.empty() ? std::string() : lines.back()), HasDied(*result)};
}

Measured Measure(v1::Job& job, const MeasuringTask& task, const fs::path& folder,
                 const JobAttempt& attempt) {
  const JobRunEnvironment& environment = attempt.environment;
  const auto failed = [](absl::Status status, errors::Reason reason) {
    return Measured{{WithDefaultReason(std::move(status), reason)}, std::nullopt};
  };
  const auto model = ResolveReference(*environment.versions, task.model);
  if (!model.ok()) return failed(model.status(), "MODEL_UNAVAILABLE");
  const std::string id(absl::StripPrefix(task.dataset, "datasets/"));
  const auto dataset = environment.datasets->Get(id);
  if (!dataset.ok()) return failed(dataset.status(), "UNUSABLE_DATA");
  if (absl::Status status = PrepareFolder(folder, ResolveExamples(task.examples)); !status.ok()) {
    return failed(status, "CANNOT_WRITE");
  }
  Measured measured;
  measured.outcome = RunTrainer(
      job,
      {"evaluate", "--model", model->folder, "--dataset", environment.datasets->FolderOf(id),
       "--settings", folder / kSettingsFile, "--output", folder / kOutput, "--sampled-examples",
       std::to_string(task.sampled_examples), "--progress", "json"},
      folder, attempt);
  if (!measured.outcome.status.ok() || attempt.stop.reason() != StopRequest::Reason::kNone) {
    return measured;
  }
  auto report = ReadReport(folder / kOutput, model->name, *dataset, task, attempt.now());
  if (!report.ok()) return {{report.status()}, std::nullopt};
  const absl::Status kept = environment.versions->KeepReport(*report);
  if (absl::IsNotFound(kept)) {
    // Somebody deleted the version; whoever asked gets the report all the same.
    monitoring::Log(monitoring::LogLevel::kWarning, "report not kept: the version is gone",
                    {{"job", job.name()}, {"model_version", model->name.ToString()}});
  } else if (!kept.ok()) {
    return failed(kept, "CANNOT_WRITE");
  }
  measured.report = *std::move(report);
  return measured;
}

}  // namespace maneuver::jobs
