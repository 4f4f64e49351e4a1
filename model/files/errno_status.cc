#include "model/files/errno_status.h"

#include <cerrno>
#include <system_error>

#include "absl/strings/str_cat.h"

namespace maneuver::files {
namespace {

struct Reading {
  absl::StatusCode code;
  std::string reason;
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
      return {absl::StatusCode::kDataLoss, "the device reports an input/output error"};
    default:
      return {absl::ErrnoToStatusCode(error), std::generic_category().message(error)};
  }
}

}  // namespace

absl::Status ErrnoStatus(int error, const char* action, const std::filesystem::path& file) {
  const Reading reading = ReadErrno(error);
  return absl::Status(reading.code,
                      absl::StrCat("cannot ", action, " ", NameOf(file), ": ", reading.reason));
}

std::string NameOf(const std::filesystem::path& file) {
  const std::filesystem::path normal = file.lexically_normal();
  return (normal.has_filename() ? normal : normal.parent_path()).filename().string();
}

}  // namespace maneuver::files
