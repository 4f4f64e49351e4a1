#include "server/jobs/recalibrate_step.h"

#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/jobs/job_folder.h"
#include "server/jobs/job_requests.h"
#include "server/jobs/job_settings.h"
#include "server/jobs/trainer_outcome.h"
#include "server/jobs/trainer_run.h"
#include "server/security/resource_name.h"

namespace maneuver::jobs {
namespace {

// The progress of the job once its model is written, if versions are to be measured then.
constexpr double kFittedAt = 0.5;

}  // namespace

bool RecalibrateStep::IsDone() const {
  std::error_code ignored;
  return !job_.model_version().empty() || std::filesystem::exists(folder_ / kOutput, ignored);
}

Outcome RecalibrateStep::Run() {
  const JobRunEnvironment& environment = attempt_.environment;
  const v1::RecalibrateRequest& request = job_.recalibrate();
  const auto version = ResolveReference(*environment.versions, request.model());
  // It may have been deleted since the job was admitted.
  if (!version.ok()) return {WithDefaultReason(version.status(), "MODEL_UNAVAILABLE")};
  absl::Status status = EnsureSettings(job_, *environment.versions, folder_);
  if (!status.ok()) return {std::move(status)};
  RemoveJobOutput(folder_);
  if (promotion_->IsByMeasurement()) attempt_.progress.SetPart(0.0, kFittedAt);
  std::vector<std::string> arguments = {"recalibrate",
                                        "--model",
                                        version->folder,
                                        "--model-name",
                                        version->name.ToString(),
                                        "--settings",
                                        folder_ / kSettingsFile,
                                        "--output",
                                        folder_ / kOutput,
                                        "--progress",
                                        "json",
                                        "--data-memory",
                                        absl::StrCat(environment.limits.data_memory)};
  for (const std::string& dataset : request.datasets()) {
    const std::string id = security::IdOf(dataset);
    arguments.insert(arguments.end(),
                     {"--dataset", environment.datasets->FolderOf(id), "--dataset-name", dataset});
  }
  return RunTrainer(job_, arguments, folder_, attempt_);
}

}  // namespace maneuver::jobs
