#include "model/files/file_receiver.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"

namespace maneuver::files {
namespace {

namespace fs = std::filesystem;

// Gives a file another name by a hard link. Where the file system has none, copies the file if its old
// name is needed again, and renames it otherwise.
absl::Status LinkOrMove(const fs::path& file, const fs::path& name, bool needed_again) {
  if (link(file.c_str(), name.c_str()) == 0) return absl::OkStatus();
  const int reason = errno;
  if (reason != EPERM && reason != EOPNOTSUPP && reason != ENOSYS && reason != EMLINK) {
    return ErrnoStatus(reason, "create", name);
  }
  std::error_code error;
  if (needed_again) {
    fs::copy_file(file, name, error);
  } else {
    fs::rename(file, name, error);
  }
  return error ? ErrnoStatus(error.value(), "create", name) : absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::unique_ptr<FileReceiver>> FileReceiver::Begin(
    std::shared_ptr<UploadStaging> staging, FileUpload upload, const CheckRoom& check_room) {
  upload.arrived.resize(upload.files.size());
  auto slot = staging->Enter(upload.id, upload.caller);
  const MutexLock lock(slot->mutex);
  if (slot->committing) {
    return absl::UnavailableError(absl::StrCat("an earlier upload of ", upload.resource,
                                               " is being checked; try again shortly"));
  }
  const std::vector<int64_t> there = ArrivedBytes(slot->folder, upload.files);
  uint64_t skipped = 0;
  for (size_t i = 0; i < there.size(); ++i) {
    if (upload.arrived[i] > there[i]) {
      return absl::UnavailableError(absl::StrCat(
          there[i], " bytes of ", upload.noun, " ", upload.files[i].name, " have arrived, not ",
          upload.arrived[i], "; ask what has arrived and continue from there"));
    }
    skipped += static_cast<uint64_t>(upload.arrived[i]);
  }
  const uint64_t wanted = BytesOf(upload.files);
  absl::Status status = staging->Announce(
      *slot, {.announced = wanted, .missing = wanted - skipped},
      [&](const UploadStaging::Others& others) { return check_room(wanted, skipped, others); });
  if (!status.ok()) return status;
  const int64_t turn = ++slot->turn;
  RemoveOtherFiles(slot->folder, upload.files);
  status = staging->MakeFolder(*slot);
  if (!status.ok()) {
    staging->End(*slot);
    return status;
  }
  return std::unique_ptr<FileReceiver>(
      new FileReceiver(std::move(staging), std::move(upload), slot, turn));
}

FileReceiver::FileReceiver(std::shared_ptr<UploadStaging> staging, FileUpload upload,
                           std::shared_ptr<UploadStaging::Slot> slot, int64_t turn)
    : staging_(std::move(staging)),
      upload_(std::move(upload)),
      slot_(std::move(slot)),
      turn_(turn) {
  for (const AnnouncedFile& each : upload_.files) was_whole_.push_back(IsWhole(each));
}

FileReceiver::~FileReceiver() {
  const MutexLock lock(slot_->mutex);
  if (slot_->turn != turn_) return;  // the files are somebody else's
  // What fails here was not acknowledged.
  if (part_ != nullptr) (void)part_->Close();
  part_.reset();
  // Not another server's by now.
  const bool is_own = staging_->HasTurn(*slot_).value_or(false);
  if (is_own && discarded_) {
    staging_->RemoveFolder(*slot_);
  } else if (is_own) {
    RemovePartWithoutAByte();
    staging_->RemoveEmptyFolder(*slot_);
  }
  staging_->End(*slot_);
}

absl::Status FileReceiver::Append(std::string_view bytes) {
  const MutexLock lock(slot_->mutex);
  if (status_.ok()) status_ = CheckTurn();
  if (status_.ok()) status_ = Take(bytes);
  return status_;
}

absl::Status FileReceiver::Commit(const fs::path& beside,
                                  const std::function<absl::Status(const fs::path&)>& publish) {
  {
    const MutexLock lock(slot_->mutex);
    if (status_.ok()) status_ = CheckTurn();
    if (status_.ok()) status_ = CheckComplete();
    if (!status_.ok()) return status_;
    slot_->committing = true;
  }
  status_ = CheckEarlierFiles();
  if (status_.ok()) {
    const auto temporary = MakeTemporaryFolderFor(beside);
    status_ = temporary.ok() ? Fill(*temporary) : temporary.status();
    if (status_.ok()) status_ = publish(*temporary);
    std::error_code ignored;
    if (temporary.ok()) fs::remove_all(*temporary, ignored);
  }
  // Nothing is left to be gone on with, or nothing that could come to a good end.
  discarded_ = status_.ok() || absl::IsInvalidArgument(status_) || absl::IsAlreadyExists(status_);
  const MutexLock lock(slot_->mutex);
  // Unless a call of another server has begun the upload anew meanwhile.
  if (discarded_ && staging_->HasTurn(*slot_).value_or(false)) staging_->RemoveFolder(*slot_);
  slot_->committing = false;
  return status_;
}

bool FileReceiver::IsWhole(const AnnouncedFile& file) const {
  std::error_code error;
  return fs::exists(WholeFile(slot_->folder, file), error);
}

absl::Status FileReceiver::CheckTurn() const {
  if (slot_->turn == turn_) {
    const auto has_turn = staging_->HasTurn(*slot_);
    if (!has_turn.ok()) return has_turn.status();
    if (*has_turn) return absl::OkStatus();
  }
  return absl::AbortedError(absl::StrCat("another upload of ", upload_.resource,
                                         " has begun meanwhile, and replaces this one"));
}

absl::Status FileReceiver::Take(std::string_view bytes) {
  for (;;) {
    if (absl::Status status = FinishFullFiles(); !status.ok()) return status;
    if (bytes.empty()) return absl::OkStatus();
    if (next_ == upload_.files.size()) {
      discarded_ = true;
      return absl::InvalidArgumentError(absl::StrCat(
          "more bytes than the header's ", upload_.noun, "s have: ", bytes.size(),
          " after the end of ", next_ == 0 ? "nothing" : upload_.files[next_ - 1].name));
    }
    if (part_ == nullptr) {
      if (absl::Status status = OpenPart(); !status.ok()) return status;
    }
    const auto left = static_cast<uint64_t>(file().size_bytes - part_->size_bytes());
    const std::string_view taken =
        bytes.substr(0, static_cast<size_t>(std::min<uint64_t>(left, bytes.size())));
    digest_->Update(taken);
    if (absl::Status status = part_->Append(taken); !status.ok()) return status;
    bytes.remove_prefix(taken.size());
    staging_->Arrived(*slot_, taken.size());
  }
}

// Opens the part of the file where what has arrived ends.
absl::Status FileReceiver::OpenPart() {
  const fs::path part = PartOfFile(slot_->folder, file());
  const int64_t offset = upload_.arrived[next_];
  digest_ = std::make_unique<Sha256>();
  if (offset == 0) {
    std::error_code ignored;
    fs::remove(part, ignored);
    auto created = OutputFile::Create(part);
    if (!created.ok()) return created.status();
    part_ = *std::move(created);
    return absl::OkStatus();
  }
  if (absl::Status status = digest_->UpdateWithFile(part, offset); !status.ok()) return status;
  auto continued = OutputFile::Continue(part, offset);
  if (!continued.ok()) return continued.status();
  part_ = *std::move(continued);
  return absl::OkStatus();
}

// Moves past the files that have all their bytes.
absl::Status FileReceiver::FinishFullFiles() {
  for (; next_ < upload_.files.size(); ++next_) {
    if (file().size_bytes == 0) continue;  // made by the commit
    if (part_ == nullptr) {
      if (upload_.arrived[next_] < file().size_bytes) return absl::OkStatus();
      if (IsWhole(file())) continue;
      if (absl::Status status = OpenPart(); !status.ok()) return status;
    }
    if (part_->size_bytes() < file().size_bytes) return absl::OkStatus();
    if (absl::Status status = ClosePart(); !status.ok()) return status;
  }
  return absl::OkStatus();
}

// Its name says that it is whole and right: not before its bytes are on the disk, and never if they
// are others.
absl::Status FileReceiver::ClosePart() {
  const fs::path part = PartOfFile(slot_->folder, file());
  std::error_code error;
  absl::Status status = part_->Close();
  part_.reset();
  if (status.ok() && digest_->Finish() != file().sha256) status = WrongDigest(file());
  if (!status.ok()) {
    fs::remove(part, error);
    return status;
  }
  fs::rename(part, WholeFile(slot_->folder, file()), error);
  if (error) return ErrnoStatus(error.value(), "rename", part);
  return SyncPath(slot_->folder);
}

void FileReceiver::RemovePartWithoutAByte() {
  if (next_ == upload_.files.size()) return;
  std::error_code error;
  const fs::path part = PartOfFile(slot_->folder, file());
  if (fs::file_size(part, error) == 0 && !error) fs::remove(part, error);
}

absl::Status FileReceiver::CheckComplete() {
  if (absl::Status status = FinishFullFiles(); !status.ok()) return status;
  if (next_ == upload_.files.size()) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("the upload ended within ", upload_.noun, " ", file().name, ": ",
                   part_ == nullptr ? upload_.arrived[next_] : part_->size_bytes(), " of ",
                   file().size_bytes, " bytes"));
}

absl::Status FileReceiver::WrongDigest(const AnnouncedFile& file) const {
  return absl::DataLossError(
      absl::StrCat(upload_.noun, " ", file.name,
                   " arrived with another SHA-256 than the header says: it was altered on its way, "
                   "or before; what came of it is thrown away; upload it again"));
}

// Those that came by an earlier call were found right then; who knows what the disk did since.
absl::Status FileReceiver::CheckEarlierFiles() const {
  for (size_t i = 0; i < upload_.files.size(); ++i) {
    const AnnouncedFile& each = upload_.files[i];
    if (!was_whole_[i] || each.size_bytes == 0) continue;
    const fs::path whole = WholeFile(slot_->folder, each);
    const auto sha256 = Sha256OfFile(whole);
    if (!sha256.ok()) return sha256.status();
    if (*sha256 == each.sha256) continue;
    std::error_code ignored;
    fs::remove(whole, ignored);
    return WrongDigest(each);
  }
  return absl::OkStatus();
}

absl::Status FileReceiver::Fill(const fs::path& temporary) const {
  const auto& files = upload_.files;
  for (auto each = files.begin(); each != files.end(); ++each) {
    absl::Status status;
    if (each->size_bytes == 0) {
      auto empty = OutputFile::Create(temporary / each->name);
      status = empty.ok() ? (*empty)->Close() : empty.status();
    } else {
      const bool again = std::any_of(each + 1, files.end(), [&](const AnnouncedFile& later) {
        return later.sha256 == each->sha256;
      });
      status = LinkOrMove(WholeFile(slot_->folder, *each), temporary / each->name, again);
    }
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

}  // namespace maneuver::files
