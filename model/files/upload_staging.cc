#include "model/files/upload_staging.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <limits>
#include <random>
#include <set>
#include <system_error>
#include <thread>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"

namespace maneuver::files {
namespace {

namespace fs = std::filesystem;

// Digits of a SHA-256: enough to tell callers apart.
constexpr size_t kCallerDigits = 32;

constexpr char kAnnounced[] = ".announced";
// An announcement whose bytes stopped coming so long ago is of an upload that broke off.
constexpr std::chrono::minutes kAnnouncementLife{2};
constexpr std::chrono::seconds kLockPatience{5};

// Excludes the other servers that use a folder.
class FolderLock {
 public:
  // UNAVAILABLE if another server holds it for long.
  static absl::StatusOr<std::unique_ptr<FolderLock>> Take(const fs::path& file) {
    const int descriptor = open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (descriptor < 0) return ErrnoStatus(errno, "create", file);
    std::unique_ptr<FolderLock> lock(new FolderLock(descriptor));
    const auto deadline = std::chrono::steady_clock::now() + kLockPatience;
    while (flock(descriptor, LOCK_EX | LOCK_NB) != 0) {
      if (errno != EWOULDBLOCK && errno != EINTR) return ErrnoStatus(errno, "lock", file);
      if (std::chrono::steady_clock::now() > deadline) {
        return absl::UnavailableError(
            "another server has been beginning an upload for long; try again shortly");
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return lock;
  }
  ~FolderLock() { close(descriptor_); }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  explicit FolderLock(int descriptor) : descriptor_(descriptor) {}

  const int descriptor_;
};

std::string NewTurn() {
  std::random_device random;
  return absl::StrCat(absl::Hex(random(), absl::kZeroPad8), absl::Hex(random(), absl::kZeroPad8));
}

// What .announced says: "TURN BYTES".
struct Announcement {
  std::string turn;
  uint64_t bytes = 0;
};

// Returns an empty one if there is none.
absl::StatusOr<Announcement> AnnouncementIn(const fs::path& slot) {
  Announcement announcement;
  const auto text = ReadFile(slot / kAnnounced);
  if (absl::IsNotFound(text.status())) return announcement;
  if (!text.ok()) return text.status();
  const std::pair<std::string, std::string> parts = absl::StrSplit(*text, ' ');
  if (absl::SimpleAtoi(parts.second, &announcement.bytes)) announcement.turn = parts.first;
  return announcement;
}

// Returns the size of a file, or -1 if there is none.
int64_t SizeOf(const fs::path& file) {
  std::error_code error;
  const uintmax_t size = fs::file_size(file, error);
  return error ? -1 : static_cast<int64_t>(size);
}

}  // namespace

uint64_t BytesOf(const std::vector<AnnouncedFile>& files) {
  uint64_t bytes = 0;
  for (const AnnouncedFile& file : files) {
    const auto size = static_cast<uint64_t>(std::max<int64_t>(0, file.size_bytes));
    bytes += std::min(size, std::numeric_limits<uint64_t>::max() - bytes);
  }
  return bytes;
}

fs::path WholeFile(const fs::path& slot, const AnnouncedFile& file) { return slot / file.sha256; }

fs::path PartOfFile(const fs::path& slot, const AnnouncedFile& file) {
  return slot / (file.sha256 + ".part");
}

std::vector<int64_t> ArrivedBytes(const fs::path& slot, const std::vector<AnnouncedFile>& files) {
  std::vector<int64_t> arrived;
  std::set<std::string> parts;  // the beginning of a file serves one of several that are alike
  for (const AnnouncedFile& file : files) {
    int64_t bytes = 0;
    if (SizeOf(WholeFile(slot, file)) == file.size_bytes) {
      bytes = file.size_bytes;
    } else if (parts.insert(file.sha256).second) {
      bytes = std::max<int64_t>(0, SizeOf(PartOfFile(slot, file)));
      if (bytes > file.size_bytes) bytes = 0;
    }
    arrived.push_back(bytes);
  }
  return arrived;
}

void RemoveOtherFiles(const fs::path& slot, const std::vector<AnnouncedFile>& files) {
  std::set<std::string> wanted;
  for (const AnnouncedFile& file : files) {
    wanted.insert(file.sha256);
    wanted.insert(file.sha256 + ".part");
  }
  std::error_code error;
  std::vector<fs::path> others;
  for (fs::directory_iterator entry(slot, error); !error && entry != fs::directory_iterator();
       entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (name != kAnnounced && !wanted.contains(name)) others.push_back(entry->path());
  }
  for (const fs::path& file : others) fs::remove(file, error);
}

UploadStaging::UploadStaging(const fs::path& folder, bool is_shared)
    : folder_(folder / ".uploads"), is_shared_(is_shared) {}

std::shared_ptr<UploadStaging::Slot> UploadStaging::Enter(const std::string& id,
                                                          const std::string& caller) {
  const std::string name = absl::StrCat(id, ".", Sha256Hex(caller).substr(0, kCallerDigits));
  const MutexLock lock(mutex_);
  std::erase_if(slots_, [](const auto& entry) { return entry.second.expired(); });
  std::weak_ptr<Slot>& known = slots_[name];
  std::shared_ptr<Slot> slot = known.lock();
  if (slot == nullptr) {
    slot = std::make_shared<Slot>();
    slot->name = name;
    slot->folder = folder_ / name;
    known = slot;
  }
  return slot;
}

absl::Status UploadStaging::Announce(Slot& slot, const Bytes& bytes,
                                     const std::function<absl::Status(const Others&)>& refuse) {
  if (is_shared_) {
    // May take seconds, in which other uploads of this server go on.
    const MutexLock turn_of_announcing(announcing_);
    const auto others = FolderLock::Take(folder_.parent_path() / ".uploads.lock");
    if (!others.ok()) return others.status();
    const MutexLock lock(mutex_);
    if (absl::Status status = refuse(OthersOnDisk(slot.name)); !status.ok()) return status;
    std::error_code error;
    fs::create_directories(slot.folder, error);
    if (error) return ErrnoStatus(error.value(), "create", slot.folder);
    const std::string turn = NewTurn();
    absl::Status status =
        WriteFileAtomically(slot.folder / kAnnounced, absl::StrCat(turn, " ", bytes.announced));
    if (status.ok()) turns_[slot.name] = turn;
    return status;
  }
  const MutexLock lock(mutex_);
  const auto known = announced_.find(slot.name);
  const Bytes own = known == announced_.end() ? Bytes() : known->second;
  Others others{.under_way = under_way_, .broken_off = BrokenOffBytes()};
  others.under_way.announced -= own.announced;
  others.under_way.missing -= own.missing;
  if (absl::Status status = refuse(others); !status.ok()) return status;
  under_way_ = {others.under_way.announced + bytes.announced,
                others.under_way.missing + bytes.missing};
  announced_[slot.name] = bytes;
  return absl::OkStatus();
}

absl::StatusOr<bool> UploadStaging::HasTurn(const Slot& slot) {
  if (!is_shared_) return true;
  const MutexLock lock(mutex_);
  const auto announcement = AnnouncementIn(slot.folder);
  if (!announcement.ok()) return announcement.status();
  return announcement->turn == turns_[slot.name];
}

void UploadStaging::Arrived(Slot& slot, uint64_t bytes) {
  if (is_shared_) return;  // all look at the files
  const MutexLock lock(mutex_);
  under_way_.missing -= bytes;
  announced_[slot.name].missing -= bytes;
}

void UploadStaging::End(Slot& slot) {
  const MutexLock lock(mutex_);
  if (is_shared_) {
    std::error_code ignored;
    const std::string turn = std::exchange(turns_[slot.name], "");
    turns_.erase(slot.name);
    const auto announcement = AnnouncementIn(slot.folder);
    if (!announcement.ok() || announcement->turn != turn) return;  // perhaps another server's
    fs::remove(slot.folder / kAnnounced, ignored);
    fs::remove(slot.folder, ignored);  // succeeds if it is empty now
    return;
  }
  const Bytes own = announced_[slot.name];
  under_way_.announced -= own.announced;
  under_way_.missing -= own.missing;
  announced_.erase(slot.name);
}

absl::Status UploadStaging::MakeFolder(const Slot& slot) {
  const MutexLock lock(mutex_);
  std::error_code error;
  if (!fs::create_directories(slot.folder, error)) {
    return error ? ErrnoStatus(error.value(), "create", slot.folder) : absl::OkStatus();
  }
  absl::Status status = SyncPath(folder_);
  status.Update(SyncPath(folder_.parent_path()));
  return status;
}

void UploadStaging::RemoveFolder(const Slot& slot) {
  const MutexLock lock(mutex_);
  std::error_code ignored;
  fs::remove_all(slot.folder, ignored);
  fs::remove(folder_, ignored);  // succeeds if it was the last
}

void UploadStaging::RemoveEmptyFolder(const Slot& slot) {
  const MutexLock lock(mutex_);
  std::error_code ignored;
  fs::remove(slot.folder, ignored);
  fs::remove(folder_, ignored);
}

absl::Status UploadStaging::RemoveIf(
    const std::function<bool(const std::string& id, fs::file_time_type last)>& is_over) {
  const MutexLock lock(mutex_);
  std::error_code error;
  if (!fs::exists(folder_, error)) return absl::OkStatus();
  std::vector<fs::path> over;
  fs::directory_iterator slot(folder_, error);
  for (; !error && slot != fs::directory_iterator(); slot.increment(error)) {
    const std::string name = slot->path().filename().string();
    if (IsHeld(name)) continue;
    std::error_code gone;  // by another server, or it is no folder
    fs::file_time_type last = fs::last_write_time(slot->path(), gone);
    for (fs::directory_iterator file(slot->path(), gone); !gone && file != fs::directory_iterator();
         file.increment(gone)) {
      last = std::max(last, file->last_write_time(gone));
    }
    if (gone) continue;
    if (is_over(name.substr(0, name.find('.')), last)) over.push_back(slot->path());
  }
  if (error) return ErrnoStatus(error.value(), "read", folder_);
  for (const fs::path& folder : over) {
    fs::remove_all(folder, error);
    if (error) return ErrnoStatus(error.value(), "remove", folder);
  }
  fs::remove(folder_, error);  // succeeds if it is empty now
  return absl::OkStatus();
}

bool UploadStaging::IsHeld(const std::string& name) const {
  const auto slot = slots_.find(name);
  return slot != slots_.end() && !slot->second.expired();
}

UploadStaging::Others UploadStaging::OthersOnDisk(const std::string& own) const {
  Others others;
  const fs::file_time_type now = fs::file_time_type::clock::now();
  std::error_code error;
  fs::directory_iterator slot(folder_, error);
  for (; !error && slot != fs::directory_iterator(); slot.increment(error)) {
    if (slot->path().filename() == own) continue;
    uint64_t there = 0;
    fs::file_time_type last = fs::file_time_type::min();
    std::error_code gone;  // its upload may just end
    for (fs::directory_iterator file(slot->path(), gone); !gone && file != fs::directory_iterator();
         file.increment(gone)) {
      if (file->path().filename().string().front() != '.') {
        there += static_cast<uint64_t>(std::max<int64_t>(0, SizeOf(file->path())));
      }
      const fs::file_time_type written = file->last_write_time(gone);
      if (!gone) last = std::max(last, written);
    }
    const uint64_t announced = AnnouncementIn(slot->path()).value_or(Announcement()).bytes;
    if (announced > 0 && last > now - kAnnouncementLife) {
      others.under_way.announced += announced;
      others.under_way.missing += announced - std::min(there, announced);
    } else {
      others.broken_off += there;
    }
  }
  return others;
}

uint64_t UploadStaging::BrokenOffBytes() const {
  uint64_t bytes = 0;
  std::error_code error;
  fs::directory_iterator slot(folder_, error);
  for (; !error && slot != fs::directory_iterator(); slot.increment(error)) {
    if (IsHeld(slot->path().filename().string())) continue;
    for (fs::directory_iterator file(slot->path(), error);
         !error && file != fs::directory_iterator(); file.increment(error)) {
      bytes += static_cast<uint64_t>(std::max<int64_t>(0, SizeOf(file->path())));
    }
  }
  return bytes;
}

}  // namespace maneuver::files
