// Messages in files, as proto3 JSON.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_SETTINGS_FILE_H_
#define MANEUVER_SERVER_JOBS_TRAINER_SETTINGS_FILE_H_

#include <google/protobuf/message.h>

#include <filesystem>

#include "absl/status/status.h"

namespace maneuver::trainer {

// INVALID_ARGUMENT if the file is not there or is not JSON of that message; unknown fields are
// errors.
absl::Status ReadJson(const std::filesystem::path& file, google::protobuf::Message* message);

// Replaces `file` in one step.
absl::Status WriteJson(const std::filesystem::path& file, const google::protobuf::Message& message);

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_SETTINGS_FILE_H_
