// Reads and edits files with secrets, which other users must not read.

#ifndef MANEUVER_SERVER_SECURITY_SECRET_FILE_H_
#define MANEUVER_SERVER_SECURITY_SECRET_FILE_H_

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace maneuver::security {

// Returns the content of a file that is read again and again while the server runs. NOT_FOUND if
// there is none. INVALID_ARGUMENT if it is no regular file, such as a pipe, whose reader waits for
// ever, or has more than 16 MiB.
absl::StatusOr<std::string> ReadReloadedFile(const std::filesystem::path& file);

// The same for a secret. PERMISSION_DENIED, with the command that repairs it, if others may read or
// write the file or its group may write it.
absl::StatusOr<std::string> ReadSecretFile(const std::filesystem::path& file);

// Replaces the content by the result of `edit`, in one step: readers see either the old or the new
// content. Waits while another process edits the file. An error of `edit` leaves the file
// unchanged. If there is no file, `edit` gets an empty text, and a file is created that only its
// owner may read.
absl::Status EditSecretFile(
    const std::filesystem::path& file,
    const std::function<absl::StatusOr<std::string>(std::string content)>& edit);

// Adds a line to the end by EditSecretFile.
//   line: ends in a newline.
absl::Status AppendLine(const std::filesystem::path& file, std::string_view line);

}  // namespace maneuver::security

#endif  // MANEUVER_SERVER_SECURITY_SECRET_FILE_H_
