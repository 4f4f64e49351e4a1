#include "model/files/abandoned_temporaries.h"

#include <string>
#include <system_error>
#include <vector>

#include "model/files/errno_status.h"

namespace maneuver::files {

namespace fs = std::filesystem;

void RemoveAbandonedTemporaries(const fs::path& parent, fs::file_time_type now) {
  std::error_code error;
  std::vector<fs::path> abandoned;
  fs::directory_iterator entry(parent, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (name.front() != '.' || name.find(kTemporaryMark, 1) == std::string::npos) continue;
    std::error_code gone;  // its writer has finished
    const auto changed = fs::last_write_time(entry->path(), gone);
    if (!gone && now - changed >= kAbandonedAfter) abandoned.push_back(entry->path());
  }
  for (const fs::path& temporary : abandoned) fs::remove_all(temporary, error);
}

}  // namespace maneuver::files
