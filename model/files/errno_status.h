// What the operating system says of a file, as a Status for people.

#ifndef MANEUVER_MODEL_FILES_ERRNO_STATUS_H_
#define MANEUVER_MODEL_FILES_ERRNO_STATUS_H_

#include <filesystem>
#include <string>

#include "absl/status/status.h"

namespace maneuver::files {

// "cannot <action> <name>: <reason>", by the last part of the path alone: no folder layout in
// messages that travel. A full disk or quota is RESOURCE_EXHAUSTED, a missing permission or a
// read-only file system PERMISSION_DENIED, a missing file NOT_FOUND, one in the way ALREADY_EXISTS,
// a folder in place of a file, or the reverse, DATA_LOSS.
//   error: a value of errno, not 0.
//   action: a verb: "write", "open", ...
absl::Status ErrnoStatus(int error, const char* action, const std::filesystem::path& file);

// The last part of a path, also of one that ends in a slash.
std::string NameOf(const std::filesystem::path& file);

}  // namespace maneuver::files

#endif  // MANEUVER_MODEL_FILES_ERRNO_STATUS_H_
