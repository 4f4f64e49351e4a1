#include "server/maneuverd/data_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <system_error>
#include <thread>

#include "absl/strings/str_cat.h"

namespace maneuver {
namespace {

// A server that was killed while it started a job leaves a child behind, which holds the lock until
// it is gone, too. Jobs have the lowest priority, so that may take a moment.
constexpr std::chrono::seconds kLockPatience{5};

bool Lock(int descriptor, int kind) {
  const auto give_up = std::chrono::steady_clock::now() + kLockPatience;
  while (flock(descriptor, kind | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK || std::chrono::steady_clock::now() >= give_up) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return true;
}

}  // namespace

absl::StatusOr<std::unique_ptr<DataLock>> DataLock::Take(const std::filesystem::path& data_dir,
                                                         bool is_shared) {
  std::error_code error;
  std::filesystem::create_directories(data_dir, error);
  if (error) {
    return absl::FailedPreconditionError(
        absl::StrCat("cannot create ", data_dir.string(), ": ", error.message()));
  }
  // Closed on exec: a trainer that outlives the server does not hold the lock.
  const std::filesystem::path file = data_dir / "maneuverd.lock";
  const int descriptor = open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (descriptor < 0) {
    return absl::FailedPreconditionError(
        absl::StrCat("cannot open ", file.string(), ": ", std::strerror(errno)));
  }
  if (!Lock(descriptor, is_shared ? LOCK_SH : LOCK_EX)) {
    close(descriptor);
    return absl::FailedPreconditionError(
        absl::StrCat("another maneuverd uses ", data_dir.string(),
                     "; stop it first, or give this one another --data-dir"));
  }
  return std::unique_ptr<DataLock>(new DataLock(descriptor));
}

std::string CloseToOthers(const std::filesystem::path& data_dir, bool is_shared) {
  using std::filesystem::perms;
  std::error_code error;
  const perms mode = std::filesystem::status(data_dir, error).permissions();
  if (error || (mode & perms::others_all) == perms::none) return "";
  // Shared ones may be meant for others; a sticky one, such as /tmp, certainly is.
  if (is_shared || (mode & perms::sticky_bit) != perms::none) {
    return "other users can enter the data folder; if none of them needs to, close it: chmod 700";
  }
  std::filesystem::permissions(data_dir, perms::owner_all, error);
  if (!error) return "other users could enter the data folder; its mode is 700 now";
  return "other users can enter the data folder, and the server cannot close it (" +
         error.message() + "); as its owner: chmod 700, or 750 for a group";
}

DataLock::~DataLock() { close(descriptor_); }

}  // namespace maneuver
