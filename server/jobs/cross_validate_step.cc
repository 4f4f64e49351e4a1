#include "server/jobs/cross_validate_step.h"

#include <google/protobuf/util/json_util.h>

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "model/files/durable_file.h"
#include "server/errors/error_details.h"
#include "server/jobs/checkpoints.h"
#include "server/jobs/job_folder.h"
#include "server/jobs/job_requests.h"
#include "server/jobs/job_settings.h"
#include "server/jobs/trainer_run.h"
#include "server/security/resource_name.h"

namespace maneuver::jobs {
namespace {

namespace fs = std::filesystem;

constexpr char kReportFile[] = "report.json";  // in the output

std::vector<std::string> CrossValidateArguments(const v1::CrossValidateRequest& request,
                                                const fs::path& folder,
                                                const JobRunEnvironment& environment) {
  const auto folder_of = [&environment](const std::string& name) {
    return environment.datasets->FolderOf(security::IdOf(name)).string();
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
                                        "--data-memory",
                                        absl::StrCat(environment.limits.data_memory),
                                        "--folds",
                                        absl::StrCat(FoldsOf(request)),
                                        "--fold-seed",
                                        absl::StrCat(FoldSeedOf(request))};
  if (!request.seeds().empty()) {
    arguments.insert(arguments.end(), {"--seeds", absl::StrJoin(request.seeds(), ",")});
  }
  for (const std::string& dataset : request.datasets()) {
    arguments.insert(arguments.end(),
                     {"--dataset", folder_of(dataset), "--dataset-name", security::IdOf(dataset)});
  }
  for (const std::string& dataset : request.test_datasets()) {
    const std::string name = security::IdOf(dataset);
    arguments.insert(arguments.end(),
                     {"--test-dataset", absl::StrCat(name, "=", folder_of(dataset))});
  }
  return arguments;
}

}  // namespace

Outcome CrossValidateStep::Run() {
  const v1::CrossValidateRequest& request = job_.cross_validate();
  absl::Status status = EnsureSettings(job_, *attempt_.environment.versions, folder_);
  if (!status.ok()) return {std::move(status)};
  RemoveJobOutput(folder_);
  Outcome outcome = RunTrainer(job_, CrossValidateArguments(request, folder_, attempt_.environment),
                               folder_, attempt_);
  if (!outcome.status.ok() || attempt_.IsStopped()) return outcome;
  const auto text = files::ReadFile(folder_ / kOutput / kReportFile);
  v1::CrossValidationReport report;
  if (!text.ok() || !google::protobuf::util::JsonStringToMessage(*text, &report).ok()) {
    return {errors::WithReason(absl::InternalError("the trainer ended well but left no report"),
                               "TRAINER_INTERNAL")};
  }
  *job_.mutable_cross_validation() = std::move(report);
  return outcome;
}

}  // namespace maneuver::jobs
