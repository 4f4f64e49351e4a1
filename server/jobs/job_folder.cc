#include "server/jobs/job_folder.h"

#include <google/protobuf/util/json_util.h>

#include <string>
#include <system_error>

#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "server/jobs/checkpoints.h"

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

}  // namespace

absl::Status PrepareFolder(const fs::path& folder, const google::protobuf::Message& settings) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return files::ErrnoStatus(error.value(), "create", folder);
  RemoveJobOutput(folder);
  return files::WriteFileAtomically(folder / kSettingsFile, ToJson(settings) + "\n");
}

void RemoveJobOutput(const fs::path& folder) {
  for (const fs::path& each : {folder, folder / kPromotionFolder}) {
    std::error_code ignored;
    fs::remove_all(each / kOutput, ignored);
    files::RemoveTemporaries(each).IgnoreError();
  }
  files::RemoveTemporaries(CheckpointFolder(folder)).IgnoreError();
}

}  // namespace maneuver::jobs
