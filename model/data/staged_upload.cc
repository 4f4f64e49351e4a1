#include "model/data/staged_upload.h"

#include <google/protobuf/util/time_util.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "model/data/dataset_layout.h"
#include "model/data/recording_index.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "model/files/output_file.h"

namespace maneuver::data {
namespace {

namespace fs = std::filesystem;
using google::protobuf::util::TimeUtil;

// A second name for a file, or its only one where the file system knows no second names.
//   needed_again: under its old name.
absl::Status NameAgain(const fs::path& file, const fs::path& name, bool needed_again) {
  if (link(file.c_str(), name.c_str()) == 0) return absl::OkStatus();
  const int reason = errno;
  if (reason != EPERM && reason != EOPNOTSUPP && reason != ENOSYS && reason != EMLINK) {
    return files::ErrnoStatus(reason, "create", name);
  }
  std::error_code error;
  if (needed_again) {
    fs::copy_file(file, name, error);
  } else {
    fs::rename(file, name, error);
  }
  return error ? files::ErrnoStatus(error.value(), "create", name) : absl::OkStatus();
}

absl::Status WrongDigest(const v1::Shard& shard) {
  return absl::DataLossError(
      absl::StrCat("shard ", shard.file(),
                   " arrived with another SHA-256 than the header says: it was altered on its way, "
                   "or before; what came of it is thrown away; upload it again"));
}

class StagedUpload final : public DatasetUpload {
 public:
  StagedUpload(StagedUploadStart start, std::shared_ptr<UploadStaging> staging)
      : id_(std::move(start.id)),
        folder_(std::move(start.folder)),
        manifest_(std::move(start.manifest)),
        arrived_(std::move(start.arrived)),
        slot_(std::move(start.slot)),
        turn_(start.turn),
        staging_(std::move(staging)) {
    for (const v1::Shard& shard : manifest_.shards()) was_whole_.push_back(IsWhole(shard));
  }

  ~StagedUpload() override {
    const std::lock_guard lock(slot_->mutex);
    if (slot_->turn != turn_) return;  // the files are somebody else's
    // What fails here was not acknowledged.
    if (file_ != nullptr) (void)file_->Close();
    file_.reset();
    if (discarded_) {
      staging_->RemoveFolder(*slot_);
    } else {
      RemovePartWithoutAByte();
      staging_->RemoveEmptyFolder(*slot_);
    }
    staging_->End(*slot_);
  }

  absl::Status Append(std::string_view bytes) override {
    const std::lock_guard lock(slot_->mutex);
    if (status_.ok()) status_ = CheckTurn();
    if (status_.ok()) status_ = Take(bytes);
    return status_;
  }

  absl::StatusOr<v1::Dataset> Commit() override {
    {
      const std::lock_guard lock(slot_->mutex);
      if (status_.ok()) status_ = CheckTurn();
      if (status_.ok()) status_ = CheckComplete();
      if (!status_.ok()) return status_;
      slot_->committing = true;
    }
    status_ = CommitOnce();
    if (!temporary_.empty() && !status_.ok()) {
      std::error_code ignored;
      fs::remove_all(temporary_, ignored);
    }
    // Nothing is left to be gone on with, or nothing that could come to a good end.
    discarded_ = status_.ok() || absl::IsInvalidArgument(status_) || absl::IsAlreadyExists(status_);
    const std::lock_guard lock(slot_->mutex);
    if (discarded_) staging_->RemoveFolder(*slot_);
    slot_->committing = false;
    if (!status_.ok()) return status_;
    return manifest_;
  }

  void Discard() override { discarded_ = true; }

 private:
  const v1::Shard& shard() const { return manifest_.shards(shard_); }
  bool IsWhole(const v1::Shard& shard) const {
    std::error_code error;
    return fs::exists(WholeShard(slot_->folder, shard), error);
  }

  absl::Status CheckTurn() const {
    if (slot_->turn == turn_) return absl::OkStatus();
    return absl::AbortedError(absl::StrCat("another upload of datasets/", id_,
                                           " has begun meanwhile, and goes on in place of this"));
  }

  absl::Status Take(std::string_view bytes) {
    for (;;) {
      if (absl::Status status = FinishFullShards(); !status.ok()) return status;
      if (bytes.empty()) return absl::OkStatus();
      if (shard_ == manifest_.shards_size()) {
        discarded_ = true;
        return absl::InvalidArgumentError(absl::StrCat(
            "more bytes than the header's shards have: ", bytes.size(), " after the end of ",
            shard_ == 0 ? "nothing" : manifest_.shards(shard_ - 1).file()));
      }
      if (file_ == nullptr) {
        if (absl::Status status = OpenShard(); !status.ok()) return status;
      }
      const auto left = static_cast<uint64_t>(shard().size_bytes() - file_->size_bytes());
      const std::string_view part =
          bytes.substr(0, static_cast<size_t>(std::min<uint64_t>(left, bytes.size())));
      digest_->Update(part);
      if (absl::Status status = file_->Append(part); !status.ok()) return status;
      bytes.remove_prefix(part.size());
      staging_->Arrived(*slot_, part.size());
    }
  }

  // Opens the part of the shard where what has arrived ends.
  absl::Status OpenShard() {
    const fs::path part = PartOfShard(slot_->folder, shard());
    const int64_t offset = arrived_[static_cast<size_t>(shard_)];
    digest_ = std::make_unique<files::Sha256>();
    if (offset == 0) {
      std::error_code ignored;
      fs::remove(part, ignored);
      auto file = files::OutputFile::Create(part);
      if (!file.ok()) return file.status();
      file_ = *std::move(file);
      return absl::OkStatus();
    }
    if (absl::Status status = digest_->UpdateWithFile(part, offset); !status.ok()) return status;
    auto file = files::OutputFile::Continue(part, offset);
    if (!file.ok()) return file.status();
    file_ = *std::move(file);
    return absl::OkStatus();
  }

  // Moves past the shards that have all their bytes.
  absl::Status FinishFullShards() {
    for (; shard_ < manifest_.shards_size(); ++shard_) {
      if (shard().size_bytes() == 0) continue;  // made by the commit
      if (file_ == nullptr) {
        const int64_t arrived = arrived_[static_cast<size_t>(shard_)];
        if (arrived < shard().size_bytes()) return absl::OkStatus();
        if (IsWhole(shard())) continue;
        if (absl::Status status = OpenShard(); !status.ok()) return status;
      }
      if (file_->size_bytes() < shard().size_bytes()) return absl::OkStatus();
      if (absl::Status status = CloseShard(); !status.ok()) return status;
    }
    return absl::OkStatus();
  }

  // Its name says that it is whole and right: not before its bytes are on the disk, and never if
  // they are others.
  absl::Status CloseShard() {
    const fs::path part = PartOfShard(slot_->folder, shard());
    std::error_code error;
    absl::Status status = file_->Close();
    file_.reset();
    if (status.ok() && digest_->Finish() != shard().sha256()) status = WrongDigest(shard());
    if (!status.ok()) {
      fs::remove(part, error);
      return status;
    }
    fs::rename(part, WholeShard(slot_->folder, shard()), error);
    if (error) return files::ErrnoStatus(error.value(), "rename", part);
    return files::SyncPath(slot_->folder);
  }

  void RemovePartWithoutAByte() {
    if (shard_ == manifest_.shards_size()) return;
    std::error_code error;
    const fs::path part = PartOfShard(slot_->folder, shard());
    if (fs::file_size(part, error) == 0 && !error) fs::remove(part, error);
  }

  absl::Status CheckComplete() {
    if (absl::Status status = FinishFullShards(); !status.ok()) return status;
    if (shard_ == manifest_.shards_size()) return absl::OkStatus();
    return absl::InvalidArgumentError(
        absl::StrCat("the upload ended within shard ", shard().file(), ": ",
                     file_ == nullptr ? arrived_[static_cast<size_t>(shard_)] : file_->size_bytes(),
                     " of ", shard().size_bytes(), " bytes"));
  }

  // Those that came by an earlier call were found right then; who knows what the disk did since.
  absl::Status CheckEarlierShards() {
    for (int i = 0; i < manifest_.shards_size(); ++i) {
      const v1::Shard& shard = manifest_.shards(i);
      if (!was_whole_[static_cast<size_t>(i)] || shard.size_bytes() == 0) continue;
      const fs::path file = WholeShard(slot_->folder, shard);
      const auto sha256 = files::Sha256OfFile(file);
      if (!sha256.ok()) return sha256.status();
      if (*sha256 == shard.sha256()) continue;
      std::error_code ignored;
      fs::remove(file, ignored);
      return WrongDigest(shard);
    }
    return absl::OkStatus();
  }

  absl::Status FillTemporary() {
    auto temporary = files::MakeTemporaryFolderFor(folder_);
    if (!temporary.ok()) return temporary.status();
    temporary_ = *std::move(temporary);
    const auto& shards = manifest_.shards();
    for (auto shard = shards.begin(); shard != shards.end(); ++shard) {
      absl::Status status;
      if (shard->size_bytes() == 0) {
        auto file = files::OutputFile::Create(temporary_ / shard->file());
        status = file.ok() ? (*file)->Close() : file.status();
      } else {
        const bool again = std::any_of(shard + 1, shards.end(), [&](const v1::Shard& later) {
          return later.sha256() == shard->sha256();
        });
        status = NameAgain(WholeShard(slot_->folder, *shard), temporary_ / shard->file(), again);
      }
      if (!status.ok()) return status;
    }
    manifest_.set_name(absl::StrCat("datasets/", id_));
    *manifest_.mutable_create_time() = TimeUtil::GetCurrentTime();
    return files::WriteFileAtomically(temporary_ / kManifestFile,
                                      PrintDatasetManifest(manifest_) + "\n");
  }

  absl::Status CommitOnce() {
    if (absl::Status status = CheckEarlierShards(); !status.ok()) return status;
    if (absl::Status status = FillTemporary(); !status.ok()) return status;
    absl::Status status = VerifyDatasetFolder(temporary_);
    // The digests agreed: it is not damaged, it never was what it should be.
    if (absl::IsDataLoss(status)) return absl::InvalidArgumentError(status.message());
    if (!status.ok()) return status;
    status = RecordingIndex::Open(temporary_).status();  // indexes each shard
    if (!status.ok()) return status;
    status = files::PublishFolder(temporary_, folder_);
    return absl::IsAlreadyExists(status) ? DatasetExists(id_) : status;
  }

  const std::string id_;
  const fs::path folder_;
  v1::Dataset manifest_;
  const std::vector<int64_t> arrived_;
  const std::shared_ptr<UploadStaging::Slot> slot_;
  const int64_t turn_;
  const std::shared_ptr<UploadStaging> staging_;
  std::vector<bool> was_whole_;  // [shards] before this call
  fs::path temporary_;           // that is being committed
  int shard_ = 0;                // that is arriving
  std::unique_ptr<files::OutputFile> file_;
  std::unique_ptr<files::Sha256> digest_;
  absl::Status status_;
  bool discarded_ = false;
};

}  // namespace

absl::Status DatasetExists(const std::string& id) {
  return absl::AlreadyExistsError(
      absl::StrCat("datasets/", id,
                   " exists already; datasets never change: choose another name, "
                   "or delete it first"));
}

std::unique_ptr<DatasetUpload> ContinueUpload(StagedUploadStart start,
                                              std::shared_ptr<UploadStaging> staging) {
  return std::make_unique<StagedUpload>(std::move(start), std::move(staging));
}

}  // namespace maneuver::data
