#include "server/jobs/decide_step.h"

namespace maneuver::jobs {

Outcome DecideStep::Run() {
  if (!promotion_->IsByMeasurement()) {
    promotion_->DecideAsPublished();
    return {};
  }
  const absl::StatusOr<PromotionTask> task = promotion_->Task();
  if (!task.ok()) {
    promotion_->DecideAgainst(task.status());
    return {};
  }
  return promotion_->Conclude(DecidePromotion(*task, *promotion_));
}

}  // namespace maneuver::jobs
