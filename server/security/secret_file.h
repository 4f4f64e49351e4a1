// Files with secrets, which other users must not read.

#ifndef MANEUVER_SERVER_SECURITY_SECRET_FILE_H_
#define MANEUVER_SERVER_SECURITY_SECRET_FILE_H_

#include <filesystem>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace maneuver::security {

// Returns the content. NOT_FOUND if there is no such file. PERMISSION_DENIED, with the command that
// repairs it, if others may read or write the file or its group may write it.
absl::StatusOr<std::string> ReadSecretFile(const std::filesystem::path& file);

// Appends a line in one step: readers see the whole line or nothing. Waits for other writers.
// Creates the file, for its owner alone, if there is none.
//   line: ends in a newline.
absl::Status AppendLine(const std::filesystem::path& file, std::string_view line);

}  // namespace maneuver::security

#endif  // MANEUVER_SERVER_SECURITY_SECRET_FILE_H_
