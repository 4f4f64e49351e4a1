#include "server/jobs/job_run.h"

#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/training_presets.h"
#include "model/files/durable_file.h"
#include "server/errors/error_details.h"
#include "server/jobs/job_requests.h"
#include "server/jobs/job_time.h"
#include "server/jobs/promotion_run.h"
#include "server/jobs/trainer_outcome.h"
#include "server/jobs/trainer_run.h"

namespace maneuver::jobs {
namespace {

namespace fs = std::filesystem;

constexpr char kReportFile[] = "report.json";  // in a cross-validation's output

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

Outcome Train(v1::Job& job, const fs::path& folder, const JobAttempt& attempt) {
  const JobRunEnvironment& environment = attempt.environment;
  const v1::TrainRequest& request = job.train();
  v1::TrainingSettings settings;
  std::vector<std::string> start;
  if (request.start_from().empty()) {
    settings = artifact::ResolveTrainingSettings(request.settings());
  } else {
    const auto version = ResolveReference(*environment.versions, request.start_from());
    if (!version.ok()) return {WithDefaultReason(version.status(), "MODEL_UNAVAILABLE")};
    const auto manifest = artifact::ReadModelManifest(version->folder);
    if (!manifest.ok()) return {WithDefaultReason(manifest.status(), "MODEL_UNAVAILABLE")};
    settings = artifact::ResolveTrainingSettings(request.settings(), manifest->spec());
    start = {"--start-from", version->folder, "--start-from-name", version->name.ToString()};
  }
  if (absl::Status status = PrepareFolder(folder, settings); !status.ok()) {
    return {WithDefaultReason(status, "CANNOT_WRITE")};
  }
  if (request.promotion() == v1::PROMOTION_IF_NO_WORSE) {
    attempt.progress.SetPart(0.0, kTrainedAt);
  }
  std::vector<std::string> arguments = TrainArguments(job, folder, environment);
  arguments.insert(arguments.end(), start.begin(), start.end());
  Outcome outcome = RunTrainer(job, std::move(arguments), folder, attempt);
  if (!outcome.status.ok() || attempt.stop.reason() != StopRequest::Reason::kNone) return outcome;
  const auto version =
      environment.versions->Publish(std::string(absl::StripPrefix(request.model(), "models/")),
                                    folder / kOutput, request.promotion(), job.name());
  if (!version.ok()) return {WithDefaultReason(version.status(), "MODEL_REFUSED")};
  job.set_model_version(version->ToString());
  return outcome;
}

Outcome Evaluate(v1::Job& job, const fs::path& folder, const JobAttempt& attempt) {
  const v1::EvaluateRequest& request = job.evaluate();
  Measured measured = Measure(
      job, {request.model(), request.dataset(), request.examples(), request.sampled_examples()},
      folder, attempt);
  if (measured.report) *job.mutable_evaluation() = *std::move(measured.report);
  return std::move(measured.outcome);
}

std::vector<std::string> CrossValidateArguments(const v1::CrossValidateRequest& request,
                                                const fs::path& folder,
                                                const data::DatasetStore& datasets) {
  const auto folder_of = [&datasets](const std::string& name) {
    return datasets.FolderOf(std::string(absl::StripPrefix(name, "datasets/"))).string();
  };
  std::vector<std::string> arguments = {"cross-validate",
                                        "--settings",
                                        folder / kSettingsFile,
                                        "--output",
                                        folder / kOutput / kReportFile,
                                        "--models",
                                        folder / kOutput / "models",
                                        "--checkpoints",
                                        CheckpointFolder(folder),
                                        "--progress",
                                        "json",
                                        "--folds",
                                        absl::StrCat(FoldsOf(request)),
                                        "--fold-seed",
                                        absl::StrCat(FoldSeedOf(request))};
  if (!request.seeds().empty()) {
    arguments.insert(arguments.end(), {"--seeds", absl::StrJoin(request.seeds(), ",")});
  }
  for (const std::string& dataset : request.datasets()) {
    arguments.insert(arguments.end(), {"--dataset", folder_of(dataset)});
  }
  for (const std::string& dataset : request.test_datasets()) {
    const std::string name(absl::StripPrefix(dataset, "datasets/"));
    arguments.insert(arguments.end(),
                     {"--test-dataset", absl::StrCat(name, "=", folder_of(dataset))});
  }
  return arguments;
}

Outcome CrossValidate(v1::Job& job, const fs::path& folder, const JobAttempt& attempt) {
  const v1::CrossValidateRequest& request = job.cross_validate();
  const v1::TrainingSettings settings = artifact::ResolveTrainingSettings(request.settings());
  if (absl::Status status = PrepareFolder(folder, settings); !status.ok()) {
    return {WithDefaultReason(status, "CANNOT_WRITE")};
  }
  Outcome outcome = RunTrainer(
      job, CrossValidateArguments(request, folder, *attempt.environment.datasets), folder, attempt);
  if (!outcome.status.ok() || attempt.stop.reason() != StopRequest::Reason::kNone) return outcome;
  const auto text = files::ReadFile(folder / kOutput / kReportFile);
  v1::CrossValidationReport report;
  if (!text.ok() || !google::protobuf::util::JsonStringToMessage(*text, &report).ok()) {
    return {errors::WithReason(absl::InternalError("the trainer ended well but left no report"),
                               "TRAINER_INTERNAL")};
  }
  *job.mutable_cross_validation() = std::move(report);
  return outcome;
}

// The version that the job's process made, if the server died after it published that and before it
// said so.
Outcome FindPublishedVersion(v1::Job& job, const JobRunEnvironment& environment) {
  if (!job.has_train() || job.attempts().started() <= 1) return {};
  const auto published = environment.versions->FindMadeBy(
      std::string(absl::StripPrefix(job.train().model(), "models/")), job.train().promotion(),
      job.name());
  if (!published.ok()) return {WithDefaultReason(published.status(), "MODEL_REFUSED")};
  if (*published) job.set_model_version((*published)->ToString());
  return {};
}

bool MadeSomething(const v1::Job& job) {
  return job.has_evaluation() || job.has_cross_validation() || !job.model_version().empty();
}

// Made a version, and is to say yet whether that is to serve.
bool IsUndecided(const v1::Job& job) {
  return !job.model_version().empty() && !job.has_promotion_decision();
}

// Does what is yet to be done.
Outcome GoOn(v1::Job& job, const fs::path& folder, const JobAttempt& attempt) {
  Outcome outcome = FindPublishedVersion(job, attempt.environment);
  if (!outcome.status.ok()) return outcome;
  const int most = attempt.environment.limits.attempts_without_progress;
  if (job.attempts().without_progress() >= most &&
      (!MadeSomething(job) || job.train().promotion() == v1::PROMOTION_IF_NO_WORSE)) {
    return {GaveUp(errors::FromProto(job.error()), most)};
  }
  const auto stopped = [&] { return attempt.stop.reason() != StopRequest::Reason::kNone; };
  if (!MadeSomething(job) && !stopped()) {
    outcome = job.has_train()            ? Train(job, folder, attempt)
              : job.has_cross_validate() ? CrossValidate(job, folder, attempt)
                                         : Evaluate(job, folder, attempt);
  }
  if (IsUndecided(job) && (!stopped() || job.train().promotion() != v1::PROMOTION_IF_NO_WORSE)) {
    outcome = RunPromotion(job, folder / kPromotionFolder, attempt);
  }
  return outcome;
}

}  // namespace

void RemoveJobOutput(const fs::path& folder) {
  for (const fs::path& each : {folder, folder / kPromotionFolder}) {
    std::error_code ignored;
    fs::remove_all(each / kOutput, ignored);
    files::RemoveTemporaries(each).IgnoreError();
  }
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
  Outcome outcome = GoOn(job, folder, {environment, stop, progress, now});
  RemoveJobOutput(folder);
  EndAttempt(job, folder, now(), outcome.died && stop.reason() == StopRequest::Reason::kNone);
  job.clear_error();
  const bool goes_on = outcome.died && job.attempts().without_progress() < most;
  if (outcome.died && !goes_on) outcome.status = GaveUp(std::move(outcome.status), most);
  // A version is there and stays, whatever befalls the decision about it. The server's end and the
  // death of a process put that off.
  if (IsUndecided(job) && stop.reason() == StopRequest::Reason::kCancelled) {
    DecideAgainst(job, absl::CancelledError("the job was cancelled"), now());
  } else if (IsUndecided(job) && stop.reason() != StopRequest::Reason::kServerStops && !goes_on) {
    DecideAgainst(job, outcome.status, now());
  }
  // Whoever asked to stop too late gets what was finished.
  if (MadeSomething(job) && !IsUndecided(job)) {
    job.set_state(v1::JOB_STATE_SUCCEEDED);
    RemoveCheckpoints(folder);
  } else if (stop.reason() == StopRequest::Reason::kCancelled) {
    job.set_state(v1::JOB_STATE_CANCELLED);
  } else if (stop.reason() == StopRequest::Reason::kServerStops) {
    job.set_state(v1::JOB_STATE_PENDING);
    *job.mutable_error() = errors::ToProto(ServerInterrupted());
  } else if (goes_on) {
    job.set_state(v1::JOB_STATE_PENDING);
    *job.mutable_error() = errors::ToProto(outcome.status);
  } else {
    job.set_state(v1::JOB_STATE_FAILED);
    *job.mutable_error() = errors::ToProto(outcome.status);
  }
  if (!job.has_error()) job.clear_last_lines();
  return job;
}

}  // namespace maneuver::jobs
