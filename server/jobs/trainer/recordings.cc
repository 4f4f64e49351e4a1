#include "server/jobs/trainer/recordings.h"

#include <utility>

#include "model/data/dataset_folder.h"
#include "server/jobs/trainer/named_folders.h"
#include "server/jobs/trainer/stop_signal.h"

namespace maneuver::trainer {

absl::StatusOr<Recordings> OpenRecordings(const std::filesystem::path& folder,
                                          int64_t data_memory) {
  absl::StatusOr<data::RecordingBlocks> blocks =
      data::RecordingBlocks::Open(folder, data_memory, [] { return !StopRequested(); });
  if (!blocks.ok()) return OfFolder(blocks.status(), folder);
  Recordings recordings{*std::move(blocks), {}};
  const absl::Status status = data::ForEachAnnotation(
      folder, data::OnDamage::kStop, [&](v1::ManeuverAnnotation&& annotation) {
        recordings.annotations.push_back(std::move(annotation));
        return !StopRequested();
      });
  if (!status.ok()) return OfFolder(status, folder);
  if (StopRequested()) return absl::CancelledError("the evaluation was stopped");
  return recordings;
}

}  // namespace maneuver::trainer
