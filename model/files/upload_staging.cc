#include "model/files/upload_staging.h"

#include <algorithm>
#include <limits>
#include <set>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"

namespace maneuver::files {
namespace {

namespace fs = std::filesystem;

// Digits of a SHA-256: enough to tell callers apart.
constexpr size_t kCallerDigits = 32;

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
    if (!wanted.contains(entry->path().filename().string())) others.push_back(entry->path());
  }
  for (const fs::path& file : others) fs::remove(file, error);
}

UploadStaging::UploadStaging(const fs::path& folder) : folder_(folder / ".uploads") {}

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

void UploadStaging::Arrived(Slot& slot, uint64_t bytes) {
  const MutexLock lock(mutex_);
  under_way_.missing -= bytes;
  announced_[slot.name].missing -= bytes;
}

void UploadStaging::End(Slot& slot) {
  const MutexLock lock(mutex_);
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
    fs::file_time_type last = fs::last_write_time(slot->path(), error);
    for (fs::directory_iterator file(slot->path(), error);
         !error && file != fs::directory_iterator(); file.increment(error)) {
      last = std::max(last, file->last_write_time(error));
    }
    if (error) break;
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
