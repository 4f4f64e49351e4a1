// The step of a training or a recalibration that measures the versions on which its promotion
// depends.

#ifndef MANEUVER_SERVER_JOBS_MEASURE_STEP_H_
#define MANEUVER_SERVER_JOBS_MEASURE_STEP_H_

#include <memory>
#include <utility>

#include "server/jobs/job_promotion.h"
#include "server/jobs/job_step.h"

namespace maneuver::jobs {

// Measures the new version and the serving one, if PROMOTION_IF_NO_WORSE compares them and they
// have no report yet. If a measurement fails, the decision is against the new version.
class MeasureStep final : public JobStep {
 public:
  explicit MeasureStep(std::shared_ptr<JobPromotion> promotion)
      : promotion_(std::move(promotion)) {}

  bool IsDone() const override;
  Outcome Run() override;

 private:
  const std::shared_ptr<JobPromotion> promotion_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_MEASURE_STEP_H_
