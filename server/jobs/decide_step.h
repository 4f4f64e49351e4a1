// The step of a training job that decides whether its version serves.

#ifndef MANEUVER_SERVER_JOBS_DECIDE_STEP_H_
#define MANEUVER_SERVER_JOBS_DECIDE_STEP_H_

#include <memory>
#include <utility>

#include "server/jobs/job_promotion.h"
#include "server/jobs/job_step.h"

namespace maneuver::jobs {

// Decides as TrainRequest.promotion says, carries the decision out, and sets
// job.promotion_decision. Only PROMOTION_IF_NO_WORSE is decided here. With any other promotion,
// publishing has already done it, and this step records the result.
class DecideStep final : public JobStep {
 public:
  explicit DecideStep(std::shared_ptr<JobPromotion> promotion) : promotion_(std::move(promotion)) {}

  bool IsDone() const override { return promotion_->IsDecided(); }
  // Returns true if the step may measure: it does so again if another version has come to serve
  // since MeasureStep.
  bool CanWait() const override { return promotion_->IsByMeasurement(); }
  Outcome Run() override;

 private:
  const std::shared_ptr<JobPromotion> promotion_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_DECIDE_STEP_H_
