#include "server/jobs/trainer/recordings.h"

#include <utility>

#include "model/data/dataset_folder.h"
#include "server/jobs/trainer/stop_signal.h"

namespace maneuver::trainer {

absl::StatusOr<Recordings> ReadRecordings(const std::filesystem::path& folder) {
  Recordings recordings;
  absl::Status status =
      data::ForEachScenario(folder, data::OnDamage::kStop, [&](v1::Scenario&& scenario) {
        recordings.scenarios.push_back(std::move(scenario));
        return !StopRequested();
      });
  if (!status.ok()) return status;
  status = data::ForEachAnnotation(folder, data::OnDamage::kStop,
                                   [&](v1::ManeuverAnnotation&& annotation) {
                                     recordings.annotations.push_back(std::move(annotation));
                                     return true;
                                   });
  if (!status.ok()) return status;
  if (StopRequested()) return absl::CancelledError("the evaluation was stopped");
  return recordings;
}

}  // namespace maneuver::trainer
