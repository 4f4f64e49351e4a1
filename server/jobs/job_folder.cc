#include "server/jobs/job_folder.h"

#include <algorithm>
#include <string>
#include <system_error>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "server/jobs/checkpoints.h"
#include "server/jobs/trainer_outcome.h"

namespace maneuver::jobs {
namespace {

namespace fs = std::filesystem;

constexpr char kAttempts[] = "attempts";

// Returns the fence of an attempt's folder; 0 for any other entry.
int64_t FenceOf(const fs::path& folder) {
  int64_t fence = 0;
  return absl::SimpleAtoi(folder.filename().string(), &fence) ? fence : 0;
}

// Links a file that is never changed in place; copies it where links are not possible. A file that
// is not there, or no more, is left out.
std::error_code Link(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::create_hard_link(from, to, error);
  if (error && error != std::errc::no_such_file_or_directory) fs::copy_file(from, to, error);
  return error == std::errc::no_such_file_or_directory ? std::error_code() : error;
}

// Links what an attempt needs of an earlier one.
std::error_code LinkAttempt(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::create_directories(CheckpointFolder(to), error);
  if (!error) fs::create_directories(to / kPromotionFolder, error);
  if (!error) error = Link(from / kSettingsFile, to / kSettingsFile);
  const fs::path decision = fs::path(kPromotionFolder) / kDecisionFile;
  if (!error) error = Link(from / decision, to / decision);
  std::error_code none;  // no checkpoint yet
  for (fs::directory_iterator entry(CheckpointFolder(from), none);
       !error && !none && entry != fs::directory_iterator(); entry.increment(none)) {
    const std::string name = entry->path().filename().string();
    if (!name.starts_with('.')) error = Link(entry->path(), CheckpointFolder(to) / name);
  }
  if (!error && none && none != std::errc::no_such_file_or_directory) error = none;
  return error;
}

}  // namespace

fs::path LatestAttemptFolder(const fs::path& job_folder) {
  int64_t latest = 0;
  std::error_code error;
  for (fs::directory_iterator entry(job_folder / kAttempts, error);
       !error && entry != fs::directory_iterator(); entry.increment(error)) {
    latest = std::max(latest, FenceOf(entry->path()));
  }
  return latest == 0 ? job_folder : job_folder / kAttempts / absl::StrCat(latest);
}

absl::StatusOr<fs::path> MakeAttemptFolder(const fs::path& job_folder, int64_t fence) {
  const fs::path earlier = LatestAttemptFolder(job_folder);
  const fs::path attempts = job_folder / kAttempts;
  fs::path folder = attempts / absl::StrCat(fence);
  const auto failed = [](const absl::Status& status) {
    return WithDefaultReason(status, "CANNOT_WRITE");
  };
  std::error_code error;
  fs::create_directories(attempts, error);
  if (error) return failed(files::ErrnoStatus(error.value(), "create", attempts));
  const auto temporary = files::MakeTemporaryFolderFor(folder);
  if (!temporary.ok()) return failed(temporary.status());
  error = LinkAttempt(earlier, *temporary);
  if (error) return failed(files::ErrnoStatus(error.value(), "fill", folder));
  absl::Status status = files::PublishFolder(*temporary, folder);
  if (!status.ok()) return failed(status);
  // From now on nobody reads the earlier ones. A later one has its worker already.
  for (fs::directory_iterator entry(attempts, error); !error && entry != fs::directory_iterator();
       entry.increment(error)) {
    std::error_code ignored;  // somebody may still write there
    if (const int64_t other = FenceOf(entry->path()); other > 0 && other < fence) {
      fs::remove_all(entry->path(), ignored);
    }
  }
  RemoveCheckpoints(job_folder);
  return folder;
}

void RemoveJobOutput(const fs::path& folder) {
  for (const fs::path& each : {folder, folder / kPromotionFolder}) {
    std::error_code ignored;
    fs::remove_all(each / kOutput, ignored);
    files::RemoveTemporaries(each).IgnoreError();
  }
  files::RemoveTemporaries(CheckpointFolder(folder)).IgnoreError();
}

}  // namespace maneuver::jobs
