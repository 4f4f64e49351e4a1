#include "server/serving/version_files.h"

#include <algorithm>
#include <array>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_folder.h"
#include "model/files/digest.h"
#include "model/files/file_system_failure.h"
#include "server/errors/error_details.h"
#include "server/serving/file_sender.h"

namespace maneuver::serving {
namespace {

namespace fs = std::filesystem;

class FolderReader final : public VersionReader {
 public:
  absl::Status OpenFolder(const security::ModelVersionName& version, const fs::path& folder) {
    header_.set_model_version(version.ToString());
    const auto manifest = artifact::ReadModelManifest(folder);
    if (files::IsFileSystemFailure(manifest.status())) {
      return errors::WithFolderReason(manifest.status(), "models");
    }
    if (!manifest.ok()) return Damaged(manifest.status().message());
    for (const char* name : {kManifestFile, kWeightsFile}) {
      if (absl::Status status = Add(folder, name); !status.ok()) return status;
    }
    std::error_code error;
    if (fs::exists(folder / kBaselinesManifestFile, error)) {
      for (const char* name : {kBaselinesManifestFile, kBaselinesWeightsFile}) {
        if (absl::Status status = Add(folder, name); !status.ok()) return status;
        auto digest = files::Sha256OfFile(folder / name);
        if (!digest.ok()) return digest.status();
        sender_.file(sender_.files().size() - 1).set_sha256(*std::move(digest));
      }
    }
    // Small, and replaced as a whole when an action gets a label: what was opened is hashed.
    const auto text = sender_.ReadWhole(0);
    if (!text.ok()) return text.status();
    sender_.file(0).set_sha256(files::Sha256Hex(*text));
    sender_.file(1).set_sha256(manifest->weights_sha256());
    *header_.mutable_files() = sender_.files();
    return absl::OkStatus();
  }

  const v1::DownloadModelHeader& header() const override { return header_; }

  absl::Status Skip(const google::protobuf::RepeatedField<int64_t>& arrived_bytes) override {
    return sender_.Skip(arrived_bytes);
  }

  absl::StatusOr<std::string> Next() override {
    auto bytes = sender_.Next();
    if (absl::IsDataLoss(bytes.status())) return Damaged(bytes.status().message());
    return bytes;
  }

 private:
  absl::Status Damaged(absl::string_view why) const {
    return errors::WithReason(
        absl::FailedPreconditionError(absl::StrCat(header_.model_version(), " is damaged: ", why)),
        "MODEL_DAMAGED", {{"model_version", header_.model_version()}});
  }

  absl::Status Add(const fs::path& folder, const char* name) {
    return sender_.Add(folder, name, FileSender::Opening::kNow);
  }

  v1::DownloadModelHeader header_;
  FileSender sender_;
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
    if (!files::IsSha256Hex(file.sha256())) {
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
    const security::ModelVersionName& name, const fs::path& folder) {
  auto reader = std::make_unique<FolderReader>();
  if (absl::Status status = reader->OpenFolder(name, folder); !status.ok()) return status;
  return reader;
}

}  // namespace maneuver::serving
