#include "model/files/durable_file.h"

#include <fcntl.h>
#include <stdio.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <system_error>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/files/errno_status.h"
#include "model/files/output_file.h"

namespace maneuver::files {
namespace {

namespace fs = std::filesystem;

fs::path FolderOf(const fs::path& file) {
  const fs::path normal = file.lexically_normal();
  const fs::path parent = (normal.has_filename() ? normal : normal.parent_path()).parent_path();
  return parent.empty() ? fs::path(".") : parent;
}

// Returns a name beside `file` that is very likely unused. The caller creates it with O_EXCL or
// mkdir, which fail if it is used after all.
fs::path TemporaryBeside(const fs::path& file) {
  uint64_t random = 0;
  if (getrandom(&random, sizeof random, 0) != sizeof random) {
    random = static_cast<uint64_t>(getpid());
  }
  return FolderOf(file) /
         absl::StrCat(".", NameOf(file), kTemporaryMark, absl::Hex(random, absl::kZeroPad16));
}

// Renames like rename(2), but never onto something that exists.
int RenameToNew(const fs::path& from, const fs::path& to) {
  if (renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) return 0;
  if (errno != EINVAL && errno != ENOSYS) return errno;
  // This file system has no RENAME_NOREPLACE, so it takes two steps.
  std::error_code error;
  if (fs::exists(fs::symlink_status(to, error))) return EEXIST;
  return rename(from.c_str(), to.c_str()) == 0 ? 0 : errno;
}

//   bytes: that are expected
absl::StatusOr<std::string> ReadAndClose(int descriptor, const fs::path& file, size_t bytes) {
  std::string content;
  content.reserve(bytes);
  char buffer[1 << 16];
  for (;;) {
    const ssize_t count = read(descriptor, buffer, sizeof buffer);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) {
      const int error = errno;
      close(descriptor);
      return ErrnoStatus(error, "read", file);
    }
    if (count == 0) break;
    content.append(buffer, static_cast<size_t>(count));
  }
  close(descriptor);
  return content;
}

}  // namespace

absl::StatusOr<std::string> ReadFile(const fs::path& file) {
  const int descriptor = open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0) return ErrnoStatus(errno, "open", file);
  struct stat about {};
  if (fstat(descriptor, &about) != 0) {
    const int error = errno;
    close(descriptor);
    return ErrnoStatus(error, "read", file);
  }
  if (!S_ISREG(about.st_mode)) {
    close(descriptor);
    return S_ISDIR(about.st_mode) ? ErrnoStatus(EISDIR, "read", file)
                                  : absl::DataLossError(NameOf(file) + " is not a file");
  }
  return ReadAndClose(descriptor, file, static_cast<size_t>(about.st_size));
}

absl::StatusOr<std::string> ReadInput(const fs::path& file) {
  const int descriptor = open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return ErrnoStatus(errno, "open", file);
  return ReadAndClose(descriptor, file, 0);
}

absl::Status WriteFileAtomically(const fs::path& file, std::string_view content) {
  const fs::path temporary = TemporaryBeside(file);
  auto output = OutputFile::Create(temporary);
  if (!output.ok()) return output.status();
  absl::Status status = (*output)->Append(content);
  // Close is called in any case; the first error is returned.
  if (const absl::Status closed = (*output)->Close(); status.ok()) status = closed;
  if (status.ok() && rename(temporary.c_str(), file.c_str()) != 0) {
    status = ErrnoStatus(errno, "replace", file);
  }
  if (!status.ok()) {
    unlink(temporary.c_str());
    return status;
  }
  return SyncPath(FolderOf(file));
}

absl::Status SyncPath(const fs::path& path) {
  const int descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return ErrnoStatus(errno, "open", path);
  const int error = fsync(descriptor) == 0 ? 0 : errno;
  close(descriptor);
  // Some network file systems cannot sync folders; nothing more can be done there.
  if (error == 0 || error == EINVAL || error == EROFS) return absl::OkStatus();
  return ErrnoStatus(error, "sync", path);
}

absl::StatusOr<std::vector<fs::path>> ListFolder(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> entries;
  fs::directory_iterator entry(folder, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    entries.push_back(entry->path());
  }
  if (error) return ErrnoStatus(error.value(), "read", folder);
  std::ranges::sort(entries);
  return entries;
}

absl::Status PublishFolder(const fs::path& temporary, const fs::path& folder) {
  if (absl::Status status = SyncFolder(temporary); !status.ok()) return status;
  return MoveIntoPlace(temporary, folder);
}

absl::Status SyncFolder(const fs::path& folder) {
  std::error_code error;
  fs::recursive_directory_iterator entry(folder, error);
  for (; !error && entry != fs::recursive_directory_iterator(); entry.increment(error)) {
    if (!entry->is_regular_file(error) && !entry->is_directory(error)) continue;
    if (const absl::Status status = SyncPath(entry->path()); !status.ok()) return status;
  }
  if (error) return ErrnoStatus(error.value(), "read", folder);
  return SyncPath(folder);
}

absl::Status MoveIntoPlace(const fs::path& temporary, const fs::path& folder) {
  if (const int reason = RenameToNew(temporary, folder); reason != 0) {
    return ErrnoStatus(reason, "create", folder);
  }
  return SyncPath(FolderOf(folder));
}

absl::StatusOr<fs::path> MakeTemporaryFolderFor(const fs::path& folder) {
  fs::path temporary = TemporaryBeside(folder);
  if (mkdir(temporary.c_str(), 0777) != 0) return ErrnoStatus(errno, "create", folder);
  return temporary;
}

absl::StatusOr<fs::path> MoveAside(const fs::path& path) {
  fs::path aside = TemporaryBeside(path);
  if (const int error = RenameToNew(path, aside); error != 0) {
    return ErrnoStatus(error, "remove", path);
  }
  if (absl::Status status = SyncPath(FolderOf(path)); !status.ok()) return status;
  return aside;
}

absl::Status RemoveTemporaries(const fs::path& parent) {
  const auto entries = ListFolder(parent);
  if (!entries.ok()) return entries.status();
  for (const fs::path& entry : *entries) {
    const std::string name = entry.filename().string();
    if (name.front() != '.' || name.find(kTemporaryMark, 1) == std::string::npos) continue;
    std::error_code error;
    fs::remove_all(entry, error);
    if (error) return ErrnoStatus(error.value(), "remove", entry);
  }
  return absl::OkStatus();
}

}  // namespace maneuver::files
