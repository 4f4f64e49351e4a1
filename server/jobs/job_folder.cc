#include "server/jobs/job_folder.h"

#include <system_error>

#include "model/files/durable_file.h"
#include "server/jobs/checkpoints.h"

namespace maneuver::jobs {

namespace fs = std::filesystem;

void RemoveJobOutput(const fs::path& folder) {
  for (const fs::path& each : {folder, folder / kPromotionFolder}) {
    std::error_code ignored;
    fs::remove_all(each / kOutput, ignored);
    files::RemoveTemporaries(each).IgnoreError();
  }
  files::RemoveTemporaries(CheckpointFolder(folder)).IgnoreError();
}

}  // namespace maneuver::jobs
