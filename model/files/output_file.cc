#include "model/files/output_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include "absl/strings/str_cat.h"
#include "model/files/errno_status.h"

namespace maneuver::files {
namespace {

constexpr size_t kBufferBytes = 256 * 1024;

}  // namespace

absl::StatusOr<std::unique_ptr<OutputFile>> OutputFile::Create(const std::filesystem::path& file) {
  const int descriptor = open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (descriptor < 0) return ErrnoStatus(errno, "create", file);
  return std::unique_ptr<OutputFile>(new OutputFile(descriptor, file));
}

absl::StatusOr<std::unique_ptr<OutputFile>> OutputFile::Continue(const std::filesystem::path& file,
                                                                 int64_t offset) {
  const int descriptor = open(file.c_str(), O_WRONLY | O_CLOEXEC);
  if (descriptor < 0) return ErrnoStatus(errno, "open", file);
  std::unique_ptr<OutputFile> output(new OutputFile(descriptor, file));
  struct stat about {};
  if (fstat(descriptor, &about) != 0) return ErrnoStatus(errno, "read", file);
  if (about.st_size < offset) {
    return absl::DataLossError(
        absl::StrCat(NameOf(file), " has ", about.st_size, " bytes and should have ", offset));
  }
  if (ftruncate(descriptor, offset) != 0 || lseek(descriptor, offset, SEEK_SET) != offset) {
    return ErrnoStatus(errno, "write", file);
  }
  output->size_bytes_ = offset;
  return output;
}

OutputFile::OutputFile(int descriptor, std::filesystem::path file)
    : descriptor_(descriptor), file_(std::move(file)) {
  buffer_.reserve(kBufferBytes);
}

OutputFile::~OutputFile() {
  if (descriptor_ >= 0) close(descriptor_);
}

absl::Status OutputFile::Append(std::string_view bytes) {
  if (!status_.ok()) return status_;
  size_bytes_ += static_cast<int64_t>(bytes.size());
  if (buffer_.size() + bytes.size() <= kBufferBytes) {
    buffer_.append(bytes);
    return absl::OkStatus();
  }
  status_ = WriteThrough(buffer_);
  buffer_.clear();
  if (!status_.ok()) return status_;
  if (bytes.size() < kBufferBytes) {
    buffer_.append(bytes);
  } else {
    status_ = WriteThrough(bytes);
  }
  return status_;
}

absl::Status OutputFile::WriteThrough(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = write(descriptor_, bytes.data(), bytes.size());
    if (written < 0) {
      if (errno == EINTR) continue;
      return ErrnoStatus(errno, "write", file_);
    }
    bytes.remove_prefix(static_cast<size_t>(written));
  }
  return absl::OkStatus();
}

absl::Status OutputFile::Close() {
  if (status_.ok()) status_ = WriteThrough(buffer_);
  if (status_.ok() && fsync(descriptor_) != 0) status_ = ErrnoStatus(errno, "sync", file_);
  // Some file systems report a failed write only now.
  if (close(descriptor_) != 0 && errno != EINTR && status_.ok()) {
    status_ = ErrnoStatus(errno, "close", file_);
  }
  descriptor_ = -1;
  return status_;
}

}  // namespace maneuver::files
