#include "server/jobs/checkpoints.h"

#include <algorithm>
#include <string_view>
#include <system_error>

#include "absl/strings/numbers.h"

namespace maneuver::jobs {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kPrefix = "checkpoint-";

}  // namespace

fs::path CheckpointFolder(const fs::path& job_folder) { return job_folder / "checkpoints"; }

int64_t LastCheckpoint(const fs::path& job_folder) {
  int64_t last = 0;
  std::error_code error;
  for (fs::directory_iterator entry(CheckpointFolder(job_folder), error);
       !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    int64_t number = 0;
    if (name.starts_with(kPrefix) && absl::SimpleAtoi(name.substr(kPrefix.size()), &number)) {
      last = std::max(last, number);
    }
  }
  return last;
}

bool RemoveCheckpoints(const fs::path& job_folder) {
  std::error_code error;
  const auto removed = fs::remove_all(CheckpointFolder(job_folder), error);
  return !error && removed > 0;
}

}  // namespace maneuver::jobs
