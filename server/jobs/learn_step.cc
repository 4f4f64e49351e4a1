#include "server/jobs/learn_step.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "model/artifact/model_folder.h"
#include "server/jobs/checkpoints.h"
#include "server/jobs/job_folder.h"
#include "server/jobs/job_requests.h"
#include "server/jobs/job_settings.h"
#include "server/jobs/trainer_outcome.h"
#include "server/jobs/trainer_run.h"
#include "server/security/resource_name.h"

namespace maneuver::jobs {
namespace {

namespace fs = std::filesystem;

// The progress of a job once its model is trained, if versions are to be measured then. The trainer
// counts the measurements in its own fraction where it can; this is for where it cannot.
constexpr double kTrainedAt = 0.99;

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
                                        absl::StrCat(environment.least_effective_actions),
                                        "--data-memory",
                                        absl::StrCat(environment.limits.data_memory)};
  for (const std::string& dataset : job.train().datasets()) {
    const std::string id = security::IdOf(dataset);
    arguments.insert(arguments.end(),
                     {"--dataset", environment.datasets->FolderOf(id), "--dataset-name", dataset});
  }
  return arguments;
}

// What starts the trainer of a job with `ranks` processes.
std::vector<std::string> LauncherOf(const JobRunEnvironment& environment, int ranks) {
  std::vector<std::string> launcher;
  for (const std::string& argument : environment.launcher) {
    launcher.push_back(absl::StrReplaceAll(argument, {{"{ranks}", absl::StrCat(ranks)}}));
  }
  return launcher;
}

}  // namespace

bool LearnStep::IsDone() const {
  std::error_code ignored;
  return !job_.model_version().empty() || fs::exists(folder_ / kOutput, ignored);
}

Outcome LearnStep::Run() {
  const JobRunEnvironment& environment = attempt_.environment;
  const v1::TrainRequest& request = job_.train();
  std::vector<std::string> start;
  if (!request.start_from().empty()) {
    const auto version = ResolveReference(*environment.versions, request.start_from());
    if (!version.ok()) return {WithDefaultReason(version.status(), "MODEL_UNAVAILABLE")};
    // It may have been deleted since the job was admitted.
    const auto manifest = artifact::ReadModelManifest(version->folder);
    if (!manifest.ok()) return {WithDefaultReason(manifest.status(), "MODEL_UNAVAILABLE")};
    start = {"--start-from", version->folder, "--start-from-name", version->name.ToString()};
  }
  absl::Status status = EnsureSettings(job_, *environment.versions, folder_);
  if (!status.ok()) return {std::move(status)};
  RemoveJobOutput(folder_);
  if (promotion_->IsByMeasurement()) attempt_.progress.SetPart(0.0, kTrainedAt);
  std::vector<std::string> arguments = TrainArguments(job_, folder_, environment);
  for (const std::vector<std::string>& more : {start, promotion_->TrainerOptions()}) {
    arguments.insert(arguments.end(), more.begin(), more.end());
  }
  if (request.ranks() > 0 && environment.launcher.empty()) {
    arguments.insert(arguments.end(), {"--ranks", absl::StrCat(request.ranks())});
  }
  return RunTrainer(job_, arguments, folder_, attempt_,
                    LauncherOf(environment, std::max(1, request.ranks())));
}

}  // namespace maneuver::jobs
