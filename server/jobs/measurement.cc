#include "server/jobs/measurement.h"

#include <google/protobuf/util/json_util.h>

#include <utility>

#include "model/data/dataset_folder.h"
#include "model/files/durable_file.h"
#include "server/errors/error_details.h"
#include "server/jobs/job_folder.h"
#include "server/jobs/job_requests.h"
#include "server/jobs/job_time.h"
#include "server/jobs/trainer_outcome.h"
#include "server/jobs/trainer_run.h"
#include "server/monitoring/logging.h"
#include "server/security/resource_name.h"

namespace maneuver::jobs {
namespace {

// Reads the trainer's report and completes it.
absl::StatusOr<v1::EvaluationReport> ReadReport(const std::filesystem::path& output,
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

Measured Measure(v1::Job& job, const MeasuringTask& task, const std::filesystem::path& folder,
                 const JobAttempt& attempt) {
  const JobRunEnvironment& environment = attempt.environment;
  const auto failed = [](absl::Status status, errors::Reason reason) {
    return Measured{{WithDefaultReason(std::move(status), reason)}, std::nullopt};
  };
  const auto model = ResolveReference(*environment.versions, task.model);
  if (!model.ok()) return failed(model.status(), "MODEL_UNAVAILABLE");
  const std::string id = security::IdOf(task.dataset);
  const auto dataset = environment.datasets->Read(id);
  if (!dataset.ok()) return failed(dataset.status(), "UNUSABLE_DATA");
  RemoveJobOutput(folder);
  Measured measured;
  measured.outcome = RunTrainer(
      job,
      {"evaluate", "--model", model->folder, "--dataset", environment.datasets->FolderOf(id),
       "--settings", folder / kSettingsFile, "--output", folder / kOutput, "--sampled-examples",
       std::to_string(task.sampled_examples), "--data-memory",
       std::to_string(environment.limits.data_memory), "--progress", "json"},
      folder, attempt);
  if (!measured.outcome.status.ok() || attempt.IsStopped()) return measured;
  auto report = ReadReport(folder / kOutput, model->name, *dataset, task, attempt.now());
  if (!report.ok()) return {{report.status()}, std::nullopt};
  const absl::Status kept = environment.versions->KeepReport(*report, attempt.maker);
  if (absl::IsNotFound(kept)) {
    // Somebody deleted the version. Whoever asked for the report gets it all the same.
    monitoring::Log(monitoring::LogLevel::kWarning, "report not kept: the version is gone",
                    {{"job", job.name()}, {"model_version", model->name.ToString()}});
  } else if (!kept.ok()) {
    return failed(kept, "CANNOT_WRITE");
  }
  measured.report = *std::move(report);
  return measured;
}

}  // namespace maneuver::jobs
