#include "server/serving/file_sender.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/files/errno_status.h"
#include "server/errors/error_details.h"

namespace maneuver::serving {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMaxChunkBytes = size_t{1} << 20;

}  // namespace

// A file, and where its next byte is read.
struct FileSender::OpenFile {
  explicit OpenFile(fs::path file) : path(std::move(file)) {}
  ~OpenFile() { Close(); }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;

  absl::Status Open() {
    if (descriptor >= 0) return absl::OkStatus();
    descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC);
    return descriptor < 0 ? files::ErrnoStatus(errno, "open", path) : absl::OkStatus();
  }
  void Close() {
    if (descriptor >= 0) close(std::exchange(descriptor, -1));
  }

  // Reads up to `most` bytes from `at`. Fewer come at the end of the file alone.
  absl::StatusOr<std::string> Read(int64_t at, size_t most) const {
    std::string bytes(most, '\0');
    size_t count = 0;
    while (count < most) {
      const ssize_t read = pread(descriptor, bytes.data() + count, most - count,
                                 static_cast<off_t>(at + static_cast<int64_t>(count)));
      if (read < 0 && errno == EINTR) continue;
      if (read < 0) return files::ErrnoStatus(errno, "read", path);
      if (read == 0) break;
      count += static_cast<size_t>(read);
    }
    bytes.resize(count);
    return bytes;
  }

  const fs::path path;
  int descriptor = -1;
  int64_t offset = 0;
};

FileSender::FileSender() = default;
FileSender::~FileSender() = default;

absl::Status FileSender::Add(const fs::path& folder, const std::string& name, Opening opening) {
  auto file = std::make_unique<OpenFile>(folder / name);
  if (absl::Status status = file->Open(); !status.ok()) return status;
  struct stat about {};
  if (fstat(file->descriptor, &about) != 0) return files::ErrnoStatus(errno, "open", file->path);
  if (opening == Opening::kLater) file->Close();
  v1::ModelFile* announced = files_.Add();
  announced->set_file(name);
  announced->set_size_bytes(about.st_size);
  open_.push_back(std::move(file));
  return absl::OkStatus();
}

absl::StatusOr<std::string> FileSender::ReadWhole(int index) const {
  return open_[static_cast<size_t>(index)]->Read(
      0, static_cast<size_t>(files_.Get(index).size_bytes()));
}

absl::Status FileSender::Skip(const google::protobuf::RepeatedField<int64_t>& arrived_bytes) {
  if (arrived_bytes.empty()) return absl::OkStatus();
  if (arrived_bytes.size() != files_.size()) {
    return errors::InvalidField(
        "arrived_bytes",
        absl::StrCat("must be empty or have a number for each of the ", files_.size(), " files"));
  }
  for (int i = 0; i < arrived_bytes.size(); ++i) {
    const int64_t size = files_.Get(i).size_bytes();
    if (arrived_bytes.Get(i) < 0 || arrived_bytes.Get(i) > size) {
      return errors::InvalidField(absl::StrCat("arrived_bytes[", i, "]"),
                                  absl::StrCat("must be from 0 to the file's size, ", size));
    }
    open_[static_cast<size_t>(i)]->offset = arrived_bytes.Get(i);
  }
  return absl::OkStatus();
}

absl::StatusOr<std::string> FileSender::Next() {
  for (; next_ < files_.size(); ++next_) {
    OpenFile& file = *open_[static_cast<size_t>(next_)];
    const v1::ModelFile& announced = files_.Get(next_);
    const auto left = static_cast<size_t>(announced.size_bytes() - file.offset);
    if (left == 0) {
      file.Close();
      continue;
    }
    if (absl::Status status = file.Open(); !status.ok()) return status;
    auto bytes = file.Read(file.offset, std::min(left, kMaxChunkBytes));
    if (bytes.ok() && bytes->empty()) {
      return absl::DataLossError(absl::StrCat(announced.file(), " has become shorter"));
    }
    if (bytes.ok()) file.offset += static_cast<int64_t>(bytes->size());
    return bytes;
  }
  return std::string();
}

}  // namespace maneuver::serving
