// Writes files and folders completely or not at all, even across a power cut. Errors: those of
// ErrnoStatus (errno_status.h). An error of syncing may come after the change was made.

#ifndef MANEUVER_MODEL_FILES_DURABLE_FILE_H_
#define MANEUVER_MODEL_FILES_DURABLE_FILE_H_

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace maneuver::files {

// Returns the whole content. NOT_FOUND if there is no such file, DATA_LOSS if it is not a file: a
// named pipe in its place is not waited for.
absl::StatusOr<std::string> ReadFile(const std::filesystem::path& file);

// Returns the whole content of what a person named: a pipe, such as <(...) of a shell, is read to
// its end. NOT_FOUND if there is no such file.
absl::StatusOr<std::string> ReadInput(const std::filesystem::path& file);

// Returns the paths of all that is in a folder, sorted.
absl::StatusOr<std::vector<std::filesystem::path>> ListFolder(const std::filesystem::path& folder);

// Replaces `file` in one step: writes a temporary file beside it, syncs it, renames it and syncs
// the folder.
absl::Status WriteFileAtomically(const std::filesystem::path& file, std::string_view content);

// Calls fsync on a file or a folder.
absl::Status SyncPath(const std::filesystem::path& path);

// Renames a finished temporary folder to its final name: SyncFolder, then MoveIntoPlace.
absl::Status PublishFolder(const std::filesystem::path& temporary,
                           const std::filesystem::path& folder);
// Syncs a folder and all that is in it. May take long.
absl::Status SyncFolder(const std::filesystem::path& folder);
// Renames a folder that is synced and syncs the parent. ALREADY_EXISTS if `folder` exists; the
// temporary folder then stays.
absl::Status MoveIntoPlace(const std::filesystem::path& temporary,
                           const std::filesystem::path& folder);

// Creates an empty folder beside `folder`, named ".<name>.tmp-<random>". RemoveTemporaries finds
// it.
absl::StatusOr<std::filesystem::path> MakeTemporaryFolderFor(const std::filesystem::path& folder);

// Takes a file or folder out of its place in one step, by a name of this kind, and syncs its
// parent. The caller removes what is at the returned path, which may take long; if it does not,
// RemoveTemporaries does. A full disk is no hindrance. NOT_FOUND if there is nothing.
absl::StatusOr<std::filesystem::path> MoveAside(const std::filesystem::path& path);

// Removes what an interrupted writer left in `parent`: entries named ".*.tmp-*".
absl::Status RemoveTemporaries(const std::filesystem::path& parent);

}  // namespace maneuver::files

#endif  // MANEUVER_MODEL_FILES_DURABLE_FILE_H_
