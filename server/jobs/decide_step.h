// The step of a training or a recalibration that decides whether its version serves.

#ifndef MANEUVER_SERVER_JOBS_DECIDE_STEP_H_
#define MANEUVER_SERVER_JOBS_DECIDE_STEP_H_

#include <memory>
#include <utility>

#include "server/jobs/job_promotion.h"
#include "server/jobs/job_step.h"

namespace maneuver::jobs {

// With PROMOTION_IF_NO_WORSE, decides whether the new version serves and carries the decision out.
// With any other promotion, publishing has already decided. Either way, the step sets
// job.promotion_decision.
class DecideStep final : public JobStep {
 public:
  explicit DecideStep(std::shared_ptr<JobPromotion> promotion) : promotion_(std::move(promotion)) {}

  bool IsDone() const override { return promotion_->IsDecided(); }
  // Returns true if the step may measure. It measures again if another version began to serve after
  // MeasureStep.
  bool CanWait() const override { return promotion_->IsByMeasurement(); }
  Outcome Run() override;

 private:
  const std::shared_ptr<JobPromotion> promotion_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_DECIDE_STEP_H_
