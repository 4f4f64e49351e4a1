#include "model/files/output_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>

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
