// Turns errors of the operating system about files into a Status that people can read.

#ifndef MANEUVER_MODEL_FILES_ERRNO_STATUS_H_
#define MANEUVER_MODEL_FILES_ERRNO_STATUS_H_

#include <filesystem>
#include <string>

#include "absl/status/status.h"

namespace maneuver::files {

// Within the names of temporary files and folders: ".NAME.tmp-NUMBER". Errors call them NAME.
inline constexpr char kTemporaryMark[] = ".tmp-";

// Returns "cannot <action> <name>: <reason>". The name is the last part of the path only: messages
// leave the machine and must not show its folders. Codes:
//   RESOURCE_EXHAUSTED: the disk or the quota is full, the file too large, too many files open.
//   PERMISSION_DENIED: a permission is missing, or the file system is read-only.
//   NOT_FOUND: the file is missing.
//   ALREADY_EXISTS: a file or a folder with content is in the way.
//   DATA_LOSS: the device failed, or there is a folder in place of a file or the reverse.
//   UNAVAILABLE: the file system is away. Others: as absl::ErrnoToStatusCode.
// Parameters:
//   error: a value of errno, not 0.
//   action: a verb: "write", "open", ...
absl::Status ErrnoStatus(int error, const char* action, const std::filesystem::path& file);

// Returns the last part of a path, also if the path ends in a slash.
std::string NameOf(const std::filesystem::path& file);

}  // namespace maneuver::files

#endif  // MANEUVER_MODEL_FILES_ERRNO_STATUS_H_
