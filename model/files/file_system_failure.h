// Tells an error of a whole file system from one of a file.

#ifndef MANEUVER_MODEL_FILES_FILE_SYSTEM_FAILURE_H_
#define MANEUVER_MODEL_FILES_FILE_SYSTEM_FAILURE_H_

#include "absl/status/status.h"

namespace maneuver::files {

// Returns whether ErrnoStatus (errno_status.h) made the status for an error of a whole file system:
// a device that failed, or a server of files that is away. It says nothing about the file.
bool IsFileSystemFailure(const absl::Status& status);

}  // namespace maneuver::files

#endif  // MANEUVER_MODEL_FILES_FILE_SYSTEM_FAILURE_H_
