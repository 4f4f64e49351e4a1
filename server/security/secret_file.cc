#include "server/security/secret_file.h"

#include <fcntl.h>
#include <stdlib.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"

namespace maneuver::security {
namespace {

namespace fs = std::filesystem;

constexpr off_t kMostReloadedBytes = off_t{16} << 20;
constexpr mode_t kForbidden = S_IWGRP | S_IROTH | S_IWOTH | S_IXOTH;

class Descriptor {
 public:
  explicit Descriptor(int value) : value_(value) {}
  ~Descriptor() {
    if (value_ >= 0) close(value_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int get() const { return value_; }

 private:
  const int value_;
};

// Returns 0 or a value of errno.
int WriteAll(int descriptor, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t count = write(descriptor, bytes.data(), bytes.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return errno;
    bytes.remove_prefix(static_cast<size_t>(count));
  }
  return fsync(descriptor) == 0 ? 0 : errno;
}

// Replaces a file like files::WriteFileAtomically, but keeps its owner and its permissions.
absl::Status ReplaceSecret(const fs::path& file, std::string_view content) {
  std::string temporary =
      (file.parent_path() / absl::StrCat(".", file.filename().string(), ".tmp-XXXXXX")).string();
  const Descriptor output(mkostemp(temporary.data(), O_CLOEXEC));  // 0600
  if (output.get() < 0) return files::ErrnoStatus(errno, "create", file);
  int error = WriteAll(output.get(), content);
  struct stat before {};
  if (error == 0 && stat(file.c_str(), &before) == 0) {
    const bool kept = fchown(output.get(), before.st_uid, before.st_gid) == 0 &&
                      fchmod(output.get(), before.st_mode & 07777) == 0;
    if (!kept) error = errno;
  }
  if (error == 0 && rename(temporary.c_str(), file.c_str()) != 0) error = errno;
  if (error == 0) return files::SyncPath(file.parent_path());
  unlink(temporary.c_str());
  return files::ErrnoStatus(error, "replace", file);
}

}  // namespace

absl::StatusOr<std::string> ReadReloadedFile(const fs::path& file) {
  struct stat about {};
  if (stat(file.c_str(), &about) != 0) return files::ErrnoStatus(errno, "open", file);
  if (!S_ISREG(about.st_mode)) {
    return absl::InvalidArgumentError(
        absl::StrCat(files::NameOf(file), " is not a file, or a link to one"));
  }
  if (about.st_size > kMostReloadedBytes) {
    return absl::InvalidArgumentError(absl::StrCat(files::NameOf(file), " has ", about.st_size,
                                                   " bytes; at most ", kMostReloadedBytes,
                                                   " are read"));
  }
  return files::ReadFile(file);
}

absl::StatusOr<std::string> ReadSecretFile(const fs::path& file) {
  struct stat about {};
  if (stat(file.c_str(), &about) != 0) return files::ErrnoStatus(errno, "open", file);
  if (S_ISREG(about.st_mode) && (about.st_mode & kForbidden) != 0) {
    return absl::PermissionDeniedError(absl::StrCat(
        files::NameOf(file), " is open to other users; close it with: chmod 600 ", file.string()));
  }
  return ReadReloadedFile(file);
}

absl::Status EditSecretFile(const fs::path& file,
                            const std::function<absl::StatusOr<std::string>(std::string)>& edit) {
  // What a link points at is changed, not the link.
  std::error_code error;
  const fs::path target = fs::weakly_canonical(fs::absolute(file), error);
  if (error) return files::ErrnoStatus(error.value(), "find", file);
  const Descriptor folder(open(target.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (folder.get() < 0) return files::ErrnoStatus(errno, "open", target.parent_path());
  if (flock(folder.get(), LOCK_EX) != 0) {
    return files::ErrnoStatus(errno, "lock", target.parent_path());
  }
  auto content = files::ReadFile(target);
  if (!content.ok() && !absl::IsNotFound(content.status())) return content.status();
  const auto edited = edit(content.ok() ? *std::move(content) : std::string());
  return edited.ok() ? ReplaceSecret(target, *edited) : edited.status();
}

absl::Status AppendLine(const fs::path& file, std::string_view line) {
  return EditSecretFile(file, [line](std::string text) -> absl::StatusOr<std::string> {
    if (!text.empty() && text.back() != '\n') text += '\n';
    return absl::StrCat(text, absl::string_view(line.data(), line.size()));
  });
}

}  // namespace maneuver::security
