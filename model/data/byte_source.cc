#include "model/data/byte_source.h"

#include <fcntl.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/files/errno_status.h"

namespace maneuver::data {
namespace {

constexpr size_t kBufferBytes = 256 * 1024;

class PlainSource final : public ByteSource {
 public:
  PlainSource(int descriptor, std::filesystem::path file)
      : descriptor_(descriptor), file_(std::move(file)), buffer_(kBufferBytes) {}
  ~PlainSource() override { close(descriptor_); }

  absl::StatusOr<size_t> Read(char* bytes, size_t size) override {
    size_t given = 0;
    while (given < size) {
      if (next_ == end_) {
        const absl::Status status = Fill();
        if (!status.ok()) return status;
        if (end_ == 0) break;
      }
      const size_t count = std::min(size - given, end_ - next_);
      std::memcpy(bytes + given, buffer_.data() + next_, count);
      next_ += count;
      given += count;
    }
    return given;
  }

 private:
  // Refills the buffer. Afterwards, end_ is 0 if the file has ended.
  absl::Status Fill() {
    ssize_t count;
    do {
      count = read(descriptor_, buffer_.data(), buffer_.size());
    } while (count < 0 && errno == EINTR);
    if (count < 0) return files::ErrnoStatus(errno, "read", file_);
    next_ = 0;
    end_ = static_cast<size_t>(count);
    return absl::OkStatus();
  }

  const int descriptor_;
  const std::filesystem::path file_;
  std::vector<char> buffer_;
  size_t next_ = 0;  // buffer_[next_, end_) has not been returned yet
  size_t end_ = 0;
};

class GzipSource final : public ByteSource {
 public:
  GzipSource(std::unique_ptr<ByteSource> packed, std::filesystem::path file)
      : packed_(std::move(packed)), file_(std::move(file)), buffer_(kBufferBytes) {
    // 15: the largest window. +16: expect a gzip header and trailer, and check the trailer's
    // CRC-32.
    ready_ = inflateInit2(&stream_, 15 + 16) == Z_OK;
  }
  ~GzipSource() override { inflateEnd(&stream_); }

  absl::StatusOr<size_t> Read(char* bytes, size_t size) override {
    if (!ready_) return absl::ResourceExhaustedError("no memory to unpack gzip");
    if (!status_.ok()) return status_;
    size_t given = 0;
    while (given < size && status_.ok() && !at_end_) given += Inflate(bytes + given, size - given);
    if (given == 0 && !status_.ok()) return status_;
    return given;  // what precedes the damage; the next call reports it
  }

 private:
  // Inflates one step. Sets status_ or at_end_ if there is no further step.
  size_t Inflate(char* bytes, size_t size) {
    if (stream_.avail_in == 0) {
      const auto count = packed_->Read(buffer_.data(), buffer_.size());
      if (!count.ok()) {
        status_ = count.status();
        return 0;
      }
      if (*count == 0) {
        if (within_member_) {
          status_ = Damaged("the gzip stream is truncated");
        } else {
          at_end_ = true;
        }
        return 0;
      }
      stream_.next_in = reinterpret_cast<Bytef*>(buffer_.data());
      stream_.avail_in = static_cast<uInt>(*count);
    }
    within_member_ = true;
    const auto room = static_cast<uInt>(std::min<size_t>(size, kBufferBytes));
    stream_.next_out = reinterpret_cast<Bytef*>(bytes);
    stream_.avail_out = room;
    const int result = inflate(&stream_, Z_NO_FLUSH);
    if (result == Z_STREAM_END) {
      within_member_ = false;
      inflateReset(&stream_);
    } else if (result != Z_OK && result != Z_BUF_ERROR) {
      status_ = Damaged("the gzip stream is damaged");
    }
    return room - stream_.avail_out;
  }

  absl::Status Damaged(const char* what) const {
    return absl::DataLossError(absl::StrCat(files::NameOf(file_), ": ", what));
  }

  const std::unique_ptr<ByteSource> packed_;
  const std::filesystem::path file_;
  std::vector<char> buffer_;
  z_stream stream_{};
  bool ready_ = false;
  bool within_member_ = true;
  bool at_end_ = false;
  absl::Status status_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<ByteSource>> OpenPlain(const std::filesystem::path& file) {
  const int descriptor = open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return files::ErrnoStatus(errno, "open", file);
  return std::make_unique<PlainSource>(descriptor, file);
}

absl::StatusOr<std::unique_ptr<ByteSource>> OpenGzip(const std::filesystem::path& file) {
  auto packed = OpenPlain(file);
  if (!packed.ok()) return packed.status();
  return std::make_unique<GzipSource>(*std::move(packed), file);
}

}  // namespace maneuver::data
