#include "server/jobs/measure_step.h"

namespace maneuver::jobs {

bool MeasureStep::IsDone() const {
  if (promotion_->IsDecided() || !promotion_->IsByMeasurement()) return true;
  if (!promotion_->HasVersion()) return false;
  const absl::StatusOr<PromotionTask> task = promotion_->Task();
  return task.ok() && VersionsToMeasure(*task, *promotion_).empty();
}

Outcome MeasureStep::Run() {
  const absl::StatusOr<PromotionTask> task = promotion_->Task();
  if (!task.ok()) {
    promotion_->DecideAgainst(task.status());
    return {};
  }
  return promotion_->Conclude(MeasureVersions(*task, *promotion_));
}

}  // namespace maneuver::jobs
