#include "server/serving/version_files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_folder.h"
#include "model/files/digest.h"
#include "model/files/errno_status.h"
#include "server/errors/error_details.h"

namespace maneuver::serving {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMaxChunkBytes = size_t{1} << 20;
constexpr size_t kSha256Digits = 64;

bool IsLowerHexadecimal(std::string_view text) {
  return std::ranges::all_of(
      text, [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

// A file that is open, and where the next byte is read.
struct OpenFile {
  explicit OpenFile(int opened) : descriptor(opened) {}
  ~OpenFile() {
    if (descriptor >= 0) close(descriptor);
  }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;

  const int descriptor;
  int64_t offset = 0;
};

// Reads up to `most` bytes. Fewer come at the end of the file alone.
absl::StatusOr<std::string> ReadAt(const OpenFile& file, size_t most, const char* name) {
  std::string bytes(most, '\0');
  size_t count = 0;
  while (count < most) {
    const ssize_t read = pread(file.descriptor, bytes.data() + count, most - count,
                               static_cast<off_t>(file.offset + static_cast<int64_t>(count)));
    if (read < 0 && errno == EINTR) continue;
    if (read < 0) return files::ErrnoStatus(errno, "read", name);
    if (read == 0) break;
    count += static_cast<size_t>(read);
  }
  bytes.resize(count);
  return bytes;
}

class FolderReader final : public VersionReader {
 public:
  absl::Status OpenFolder(const ModelRegistry::ResolvedVersion& version) {
    header_.set_model_version(version.name.ToString());
    const auto manifest = artifact::ReadModelManifest(version.folder);
    if (!manifest.ok()) return Damaged(manifest.status().message());
    for (const char* name : {kManifestFile, kWeightsFile}) {
      if (absl::Status status = Add(version.folder, name); !status.ok()) return status;
    }
    std::error_code error;
    if (fs::exists(version.folder / kBaselinesManifestFile, error)) {
      for (const char* name : {kBaselinesManifestFile, kBaselinesWeightsFile}) {
        if (absl::Status status = Add(version.folder, name); !status.ok()) return status;
        auto digest = files::Sha256OfFile(version.folder / name);
        if (!digest.ok()) return digest.status();
        header_.mutable_files()->rbegin()->set_sha256(*std::move(digest));
      }
    }
    // Small, and replaced as a whole when an action gets a label: what was opened is hashed.
    const auto text = ReadAt(*files_[0], static_cast<size_t>(header_.files(0).size_bytes()), "");
    if (!text.ok()) return text.status();
    header_.mutable_files(0)->set_sha256(files::Sha256Hex(*text));
    header_.mutable_files(1)->set_sha256(manifest->weights_sha256());
    return absl::OkStatus();
  }

  const v1::DownloadModelHeader& header() const override { return header_; }

  absl::Status Skip(const google::protobuf::RepeatedField<int64_t>& arrived_bytes) override {
    if (arrived_bytes.empty()) return absl::OkStatus();
    if (arrived_bytes.size() != header_.files_size()) {
      return errors::InvalidField("arrived_bytes",
                                  absl::StrCat("must be empty or have a number for each of the ",
                                               header_.files_size(), " files"));
    }
    for (int i = 0; i < arrived_bytes.size(); ++i) {
      const int64_t size = header_.files(i).size_bytes();
      if (arrived_bytes.Get(i) < 0 || arrived_bytes.Get(i) > size) {
        return errors::InvalidField(absl::StrCat("arrived_bytes[", i, "]"),
                                    absl::StrCat("must be from 0 to the file's size, ", size));
      }
      files_[static_cast<size_t>(i)]->offset = arrived_bytes.Get(i);
    }
    return absl::OkStatus();
  }

  absl::StatusOr<std::string> Next() override {
    for (; next_ < files_.size(); ++next_) {
      OpenFile& file = *files_[next_];
      const v1::ModelFile& announced = header_.files(static_cast<int>(next_));
      const auto left = static_cast<size_t>(announced.size_bytes() - file.offset);
      if (left == 0) continue;
      auto bytes = ReadAt(file, std::min(left, kMaxChunkBytes), announced.file().c_str());
      if (bytes.ok() && bytes->empty()) {
        return Damaged(absl::StrCat(announced.file(), " has become shorter"));
      }
      if (bytes.ok()) file.offset += static_cast<int64_t>(bytes->size());
      return bytes;
    }
    return std::string();
  }

 private:
  absl::Status Damaged(absl::string_view why) const {
    return errors::WithReason(
        absl::FailedPreconditionError(absl::StrCat(header_.model_version(), " is damaged: ", why)),
        "MODEL_DAMAGED", {{"model_version", header_.model_version()}});
  }

  absl::Status Add(const fs::path& folder, const char* name) {
    const fs::path path = folder / name;
    auto file = std::make_unique<OpenFile>(open(path.c_str(), O_RDONLY | O_CLOEXEC));
    struct stat about {};
    if (file->descriptor < 0 || fstat(file->descriptor, &about) != 0) {
      return files::ErrnoStatus(errno, "open", path);
    }
    v1::ModelFile* announced = header_.add_files();
    announced->set_file(name);
    announced->set_size_bytes(about.st_size);
    files_.push_back(std::move(file));
    return absl::OkStatus();
  }

  v1::DownloadModelHeader header_;
  std::vector<std::unique_ptr<OpenFile>> files_;  // in the order of the header
  size_t next_ = 0;
};

}  // namespace

std::vector<scene::FieldViolation> ValidateVersionFiles(
    const google::protobuf::RepeatedPtrField<v1::ModelFile>& files) {
  struct Known {
    std::string_view name;
    int64_t most_bytes;
    bool seen = false;
  };
  std::array<Known, 4> known = {Known{kManifestFile, kMaxManifestBytes},
                                Known{kWeightsFile, kMaxWeightsBytes},
                                Known{kBaselinesManifestFile, kMaxManifestBytes},
                                Known{kBaselinesWeightsFile, kMaxWeightsBytes}};
  std::vector<scene::FieldViolation> violations;
  if (files.size() > static_cast<int>(known.size())) {
    return {{"files", absl::StrCat("must be at most ", known.size())}};
  }
  for (int i = 0; i < files.size(); ++i) {
    const v1::ModelFile& file = files.Get(i);
    const std::string field = absl::StrCat("files[", i, "]");
    auto* const found = std::ranges::find(known, file.file(), &Known::name);
    if (found == known.end() || std::exchange(found->seen, true)) {
      violations.push_back(
          {field + ".file",
           absl::StrCat("must be one of ", kManifestFile, ", ", kWeightsFile, ", ",
                        kBaselinesManifestFile, " and ", kBaselinesWeightsFile, ", each once")});
      continue;
    }
    if (file.size_bytes() < 1 || file.size_bytes() > found->most_bytes) {
      violations.push_back(
          {field + ".size_bytes", absl::StrCat("must be from 1 to ", found->most_bytes)});
    }
    if (file.sha256().size() != kSha256Digits || !IsLowerHexadecimal(file.sha256())) {
      violations.push_back({field + ".sha256", "must be 64 lower-case hexadecimal digits"});
    }
  }
  const bool has_model = known[0].seen && known[1].seen;
  if (violations.empty() && (!has_model || known[2].seen != known[3].seen)) {
    violations.push_back({"files", absl::StrCat("must have ", kManifestFile, " and ", kWeightsFile,
                                                ", and both of ", kBaselinesManifestFile, " and ",
                                                kBaselinesWeightsFile, " or neither")});
  }
  return violations;
}

absl::StatusOr<std::unique_ptr<VersionReader>> VersionReader::Open(
    const ModelRegistry::ResolvedVersion& version) {
  auto reader = std::make_unique<FolderReader>();
  if (absl::Status status = reader->OpenFolder(version); !status.ok()) return status;
  return reader;
}

}  // namespace maneuver::serving
