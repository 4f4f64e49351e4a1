#include "server/serving/version_uploads.h"

#include <algorithm>
#include <optional>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/anchor_baselines.h"
#include "model/artifact/model_folder.h"
#include "model/files/digest.h"
#include "model/files/file_receiver.h"
#include "model/files/file_system_failure.h"
#include "server/serving/version_description.h"
#include "server/serving/version_files.h"

namespace maneuver::serving {
namespace {

namespace fs = std::filesystem;
using FileList = google::protobuf::RepeatedPtrField<v1::ModelFile>;

// Left free by every upload, for jobs and their store.
constexpr uint64_t kSpareBytes = uint64_t{64} << 20;

std::vector<files::AnnouncedFile> Announced(const FileList& files) {
  std::vector<files::AnnouncedFile> announced;
  for (const v1::ModelFile& file : files) {
    announced.push_back({file.file(), file.size_bytes(), file.sha256()});
  }
  return announced;
}

// Whom a version that is made of these files names as its maker.
std::string MakerOf(const FileList& files) {
  std::vector<std::string> lines;
  for (const v1::ModelFile& file : files) {
    lines.push_back(absl::StrCat(file.file(), " ", file.sha256(), "\n"));
  }
  std::ranges::sort(lines);
  std::string text;
  for (const std::string& line : lines) text += line;
  return absl::StrCat("uploads/", files::Sha256Hex(text));
}

// Whether a version's folder holds just these files.
bool HoldsFiles(const fs::path& folder, const FileList& files) {
  bool with_baselines = false;
  for (const v1::ModelFile& file : files) {
    absl::StatusOr<std::string> digest;
    if (file.file() == kWeightsFile) {  // large, and its manifest vouches for it
      const auto manifest = artifact::ReadModelManifest(folder);
      if (!manifest.ok()) return false;
      digest = manifest->weights_sha256();
    } else {
      digest = files::Sha256OfFile(folder / file.file());
    }
    if (!digest.ok() || *digest != file.sha256()) return false;
    with_baselines = with_baselines || file.file() == kBaselinesManifestFile;
  }
  std::error_code error;
  return fs::exists(folder / kBaselinesManifestFile, error) == with_baselines;
}

// The newest version of the model that an upload of these files made, or that has just them now.
std::optional<security::ModelVersionName> FindSame(const VersionStore& versions,
                                                   const std::string& model,
                                                   const FileList& files) {
  if (auto made = versions.FindMadeBy(model, MakerOf(files))) return made;
  for (const VersionStore::StoredVersion& version : versions.List(model)) {
    if (HoldsFiles(versions.FolderOf(version.name), files)) return version.name;
  }
  return std::nullopt;
}

// Whether it is the server that could not read a model's files, not the files that are wrong.
bool IsOfServer(const absl::Status& status) {
  return files::IsFileSystemFailure(status) || absl::IsResourceExhausted(status);
}

class ReceivedVersion final : public VersionUpload {
 public:
  // VersionUploads says what the arguments are; those that are references must outlive this object.
  ReceivedVersion(std::string model, FileList files, fs::path beside, VersionStore& versions,
                  ServingTable& table, const ModelCheck& check, Mutex& registering,
                  std::unique_ptr<files::FileReceiver> receiver)
      : model_(std::move(model)),
        files_(std::move(files)),
        beside_(std::move(beside)),
        versions_(versions),
        table_(table),
        check_(check),
        registering_(registering),
        receiver_(std::move(receiver)) {}

  absl::Status Append(std::string_view bytes) override { return receiver_->Append(bytes); }

  absl::StatusOr<v1::ModelVersion> Commit() override {
    const absl::Status status = receiver_->Commit(
        beside_, [this](const fs::path& temporary) { return Publish(temporary); });
    if (!status.ok()) return status;
    return DescribeVersion(versions_, table_, *name_);
  }

  void Discard() override { receiver_->Discard(); }

 private:
  absl::Status Publish(const fs::path& folder) {
    name_ = versions_.FindMadeBy(model_, MakerOf(files_));
    if (name_) return absl::OkStatus();
    if (absl::Status status = check_(folder); !status.ok()) {
      if (IsOfServer(status)) return status;
      // The digests agreed: it is not damaged, it never was what it should be.
      return absl::InvalidArgumentError(
          absl::StrCat("the files are not a model: ", status.message()));
    }
    return Register(folder);
  }

  absl::Status Register(const fs::path& folder) {
    const MutexLock lock(registering_);
    // Another caller may have registered it, here or at another server, while it was checked.
    const serving::Maker maker{MakerOf(files_)};
    const auto found = table_.FindMadeBy(model_, v1::PROMOTION_NEVER, maker);
    if (!found.ok()) return found.status();
    name_ = *found;
    if (name_) return absl::OkStatus();
    auto made = table_.Publish(model_, folder, v1::PROMOTION_NEVER, maker);
    if (made.ok()) name_ = *made;
    if (absl::IsFailedPrecondition(made.status())) {
      return absl::InvalidArgumentError(made.status().message());
    }
    return made.status();
  }

  const std::string model_;
  const FileList files_;
  const fs::path beside_;
  VersionStore& versions_;
  ServingTable& table_;
  const ModelCheck& check_;
  Mutex& registering_;
  const std::unique_ptr<files::FileReceiver> receiver_;
  std::optional<security::ModelVersionName> name_;  // once it is registered
};

}  // namespace

absl::Status CheckModelFolder(const fs::path& folder) {
  if (const auto model = artifact::ReadModelFolder(folder); !model.ok()) return model.status();
  const auto baselines = artifact::ReadBaselines(folder);
  return absl::IsNotFound(baselines.status()) ? absl::OkStatus() : baselines.status();
}

VersionUploads::VersionUploads(fs::path folder, VersionStore& versions, ServingTable& table,
                               std::chrono::seconds keep, bool is_shared, ModelCheck check)
    : folder_(std::move(folder)),
      versions_(versions),
      table_(table),
      check_(std::move(check)),
      keep_(keep),
      staging_(std::make_shared<files::UploadStaging>(folder_, is_shared)) {}

absl::Status VersionUploads::CheckRoom(uint64_t wanted, uint64_t arrived, uint64_t missing) const {
  std::error_code error;
  const fs::space_info space = fs::space(folder_, error);
  const uint64_t taken = kSpareBytes + missing;
  const uint64_t needed = wanted - std::min(arrived, wanted);
  if (!error && (space.available < taken || needed > space.available - taken)) {
    return absl::ResourceExhaustedError(absl::StrCat(
        "the version needs ", needed, " bytes and the server has ",
        space.available < taken ? 0 : space.available - taken, " left (", kSpareBytes >> 20,
        " MiB stay free); delete datasets or models that are no longer needed"));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<VersionUpload>> VersionUploads::Begin(
    const std::string& model, const v1::UploadModelHeader& header, const std::string& caller) {
  auto receiver = files::FileReceiver::Begin(
      staging_,
      {.id = model,
       .resource = absl::StrCat("a version of models/", model),
       .noun = "file",
       .caller = caller,
       .files = Announced(header.files()),
       .arrived = {header.arrived_bytes().begin(), header.arrived_bytes().end()}},
      [this](uint64_t wanted, uint64_t arrived, const files::UploadStaging::Others& others) {
        return CheckRoom(wanted, arrived, others.under_way.missing);
      });
  if (!receiver.ok()) return receiver.status();
  return std::make_unique<ReceivedVersion>(model, header.files(), folder_ / model, versions_,
                                           table_, check_, registering_, *std::move(receiver));
}

absl::StatusOr<v1::QueryModelUploadResponse> VersionUploads::Query(const std::string& model,
                                                                   const FileList& files,
                                                                   const std::string& caller) {
  v1::QueryModelUploadResponse response;
  if (const auto same = FindSame(versions_, model, files)) {
    auto version = DescribeVersion(versions_, table_, *same);
    if (!version.ok()) return version.status();
    *response.mutable_committed() = *std::move(version);
  }
  for (const int64_t bytes :
       files::ArrivedBytes(staging_->Enter(model, caller)->folder, Announced(files))) {
    response.add_arrived_bytes(bytes);
  }
  return response;
}

absl::Status VersionUploads::RemoveAbandoned(fs::file_time_type now) {
  if (keep_.count() <= 0) return absl::OkStatus();
  return staging_->RemoveIf(
      [&](const std::string&, fs::file_time_type last) { return now - last > keep_; });
}

}  // namespace maneuver::serving
