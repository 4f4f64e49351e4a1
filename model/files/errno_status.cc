#include "model/files/errno_status.h"

#include <cerrno>
#include <system_error>

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "model/files/file_system_failure.h"

namespace maneuver::files {
namespace {

// Marks a status for IsFileSystemFailure. It stays in the process.
constexpr char kFileSystemFailure[] = "maneuver/file-system-failure";

struct Reading {
  absl::StatusCode code;
  std::string reason;
  bool is_of_file_system = false;
};

Reading ReadErrno(int error) {
  switch (error) {
    case ENOSPC:
      return {absl::StatusCode::kResourceExhausted, "the disk is full"};
    case EDQUOT:
      return {absl::StatusCode::kResourceExhausted, "the disk quota is used up"};
    case EFBIG:
      return {absl::StatusCode::kResourceExhausted, "the file would be larger than is allowed"};
    case EMFILE:
    case ENFILE:
      return {absl::StatusCode::kResourceExhausted, "too many files are open"};
    case EACCES:
    case EPERM:
      return {absl::StatusCode::kPermissionDenied, "permission denied"};
    case EROFS:
      return {absl::StatusCode::kPermissionDenied, "the file system is read-only"};
    case ENOENT:
      return {absl::StatusCode::kNotFound, "no such file or folder"};
    case EEXIST:
    case ENOTEMPTY:
      return {absl::StatusCode::kAlreadyExists, "it exists already"};
    case EISDIR:
    case ENOTDIR:
      return {absl::StatusCode::kDataLoss, "something else is in its place"};
    case EIO:
      return {absl::StatusCode::kDataLoss, "the device reports an input/output error", true};
    case ENOTCONN:  // a FUSE file system whose process is gone
    case ESTALE:
    case ETIMEDOUT:
    case EHOSTDOWN:
    case EHOSTUNREACH:
    case ENETDOWN:
    case ENETUNREACH:
    case ECONNABORTED:
    case ECONNREFUSED:
    case ECONNRESET:
    case EREMOTEIO:
    case ENOLINK:
    case ENODEV:
    case ESHUTDOWN:
      return {
          absl::StatusCode::kUnavailable,
          absl::StrCat("its file system is away (", std::generic_category().message(error), ")"),
          true};
    default:
      return {absl::ErrnoToStatusCode(error), std::generic_category().message(error)};
  }
}

// Returns the name that a temporary file or folder will have; other names unchanged.
std::string FinalName(const std::string& name) {
  const size_t mark = name.find(kTemporaryMark, 1);
  return name.starts_with(".") && mark != std::string::npos ? name.substr(1, mark - 1) : name;
}

}  // namespace

absl::Status ErrnoStatus(int error, const char* action, const std::filesystem::path& file) {
  const Reading reading = ReadErrno(error);
  absl::Status status(reading.code, absl::StrCat("cannot ", action, " ", FinalName(NameOf(file)),
                                                 ": ", reading.reason));
  if (reading.is_of_file_system) status.SetPayload(kFileSystemFailure, absl::Cord());
  return status;
}

bool IsFileSystemFailure(const absl::Status& status) {
  return status.GetPayload(kFileSystemFailure).has_value();
}

std::string NameOf(const std::filesystem::path& file) {
  const std::filesystem::path normal = file.lexically_normal();
  return (normal.has_filename() ? normal : normal.parent_path()).filename().string();
}

}  // namespace maneuver::files
