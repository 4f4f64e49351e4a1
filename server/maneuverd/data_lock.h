#ifndef MANEUVER_SERVER_MANEUVERD_DATA_LOCK_H_
#define MANEUVER_SERVER_MANEUVERD_DATA_LOCK_H_

#include <filesystem>
#include <memory>

#include "absl/status/statusor.h"

namespace maneuver {

// Keeps other servers off a data folder, or all that do not share it, until it is destroyed or the
// process ends.
class DataLock {
 public:
  // Locks the folder, and creates it if it is missing. FAILED_PRECONDITION if another server has
  // it for the next five seconds, or it cannot be created or written to.
  //   is_shared: other servers that share it may have it, too
  static absl::StatusOr<std::unique_ptr<DataLock>> Take(const std::filesystem::path& data_dir,
                                                        bool is_shared = false);
  ~DataLock();
  DataLock(const DataLock&) = delete;
  DataLock& operator=(const DataLock&) = delete;

 private:
  explicit DataLock(int descriptor) : descriptor_(descriptor) {}

  const int descriptor_;
};

// Closes a data folder that other users can enter: its mode becomes 700. One that they cannot enter
// keeps its mode, such as 750, which lets a group in; so does one that is shared, sticky or another
// user's. Returns a line for the log: what was changed, or what to do; empty if others cannot
// enter.
std::string CloseToOthers(const std::filesystem::path& data_dir, bool is_shared);

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_DATA_LOCK_H_
