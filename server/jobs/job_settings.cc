#include "server/jobs/job_settings.h"

#include <google/protobuf/util/json_util.h>

#include <string>
#include <system_error>

#include "absl/status/statusor.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/training_presets.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "server/jobs/job_folder.h"
#include "server/jobs/job_requests.h"
#include "server/jobs/trainer_outcome.h"

namespace maneuver::jobs {
namespace {

namespace fs = std::filesystem;

absl::StatusOr<v1::TrainingSettings> SettingsOf(const v1::TrainRequest& request,
                                                const serving::ModelVersions& versions) {
  if (request.start_from().empty()) return artifact::ResolveTrainingSettings(request.settings());
  const auto start = ResolveReference(versions, request.start_from());
  if (!start.ok()) return WithDefaultReason(start.status(), "MODEL_UNAVAILABLE");
  const auto manifest = artifact::ReadModelManifest(start->folder);
  if (!manifest.ok()) return WithDefaultReason(manifest.status(), "MODEL_UNAVAILABLE");
  return artifact::ResolveTrainingSettings(request.settings(), manifest->spec());
}

}  // namespace

absl::Status WriteSettings(const google::protobuf::Message& settings, const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) {
    return WithDefaultReason(files::ErrnoStatus(error.value(), "create", folder), "CANNOT_WRITE");
  }
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  std::string json;
  // Fails only for messages that no request can hold (Any).
  (void)google::protobuf::util::MessageToJsonString(settings, &json, options);
  const absl::Status status = files::WriteFileAtomically(folder / kSettingsFile, json + "\n");
  return status.ok() ? status : WithDefaultReason(status, "CANNOT_WRITE");
}

absl::Status EnsureSettings(const v1::Job& job, const serving::ModelVersions& versions,
                            const fs::path& folder) {
  std::error_code ignored;
  if (fs::exists(folder / kSettingsFile, ignored)) return absl::OkStatus();
  if (job.has_evaluate()) return WriteSettings(ResolveExamples(job.evaluate().examples()), folder);
  if (job.has_recalibrate()) {
    return WriteSettings(ResolveExamples(job.recalibrate().examples()), folder);
  }
  if (job.has_tag()) return WriteSettings(job.tag(), folder);
  if (job.has_cross_validate()) {
    return WriteSettings(artifact::ResolveTrainingSettings(job.cross_validate().settings()),
                         folder);
  }
  const absl::StatusOr<v1::TrainingSettings> settings = SettingsOf(job.train(), versions);
  return settings.ok() ? WriteSettings(*settings, folder) : settings.status();
}

}  // namespace maneuver::jobs
