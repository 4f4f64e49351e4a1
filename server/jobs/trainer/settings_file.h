// Reads and writes messages as proto3 JSON files.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_SETTINGS_FILE_H_
#define MANEUVER_SERVER_JOBS_TRAINER_SETTINGS_FILE_H_

#include <google/protobuf/message.h>

#include <filesystem>

#include "absl/status/status.h"

namespace maneuver::trainer {

// Reads a message. INVALID_ARGUMENT if the file is missing or is not JSON of that message; unknown
// fields are errors.
absl::Status ReadJson(const std::filesystem::path& file, google::protobuf::Message* message);

// Writes a message, replacing `file` in one step. Errors: those of files::WriteFileAtomically.
absl::Status WriteJson(const std::filesystem::path& file, const google::protobuf::Message& message);

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_SETTINGS_FILE_H_
