#include "server/jobs/trainer/settings_file.h"

#include <google/protobuf/util/json_util.h>

#include <string>

#include "absl/status/statusor.h"
#include "model/files/durable_file.h"

namespace maneuver::trainer {

absl::Status ReadJson(const std::filesystem::path& file, google::protobuf::Message* message) {
  const absl::StatusOr<std::string> json = files::ReadInput(file);
  if (!json.ok()) {
    return absl::InvalidArgumentError(file.filename().string() + ": " +
                                      std::string(json.status().message()));
  }
  const auto status = google::protobuf::util::JsonStringToMessage(*json, message);
  if (!status.ok()) {
    return absl::InvalidArgumentError(file.filename().string() + " is not a " +
                                      message->GetDescriptor()->name() +
                                      " in JSON: " + std::string(status.message()));
  }
  return absl::OkStatus();
}

absl::Status WriteJson(const std::filesystem::path& file,
                       const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  options.preserve_proto_field_names = true;
  std::string json;
  const auto status = google::protobuf::util::MessageToJsonString(message, &json, options);
  if (!status.ok()) return absl::InternalError(std::string(status.message()));
  return files::WriteFileAtomically(file, json);
}

}  // namespace maneuver::trainer
