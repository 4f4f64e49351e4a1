// The step of a recalibration job in which the trainer fits the widths of a version again.

#ifndef MANEUVER_SERVER_JOBS_RECALIBRATE_STEP_H_
#define MANEUVER_SERVER_JOBS_RECALIBRATE_STEP_H_

#include <filesystem>
#include <memory>
#include <utility>

#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/job_promotion.h"
#include "server/jobs/job_step.h"

namespace maneuver::jobs {

// Writes the model to the output folder of the job. Writes no checkpoints: if a process dies, the
// next one begins anew.
class RecalibrateStep final : public JobStep {
 public:
  // `job` and `attempt` must outlive the step.
  RecalibrateStep(v1::Job& job, std::filesystem::path folder, const JobAttempt& attempt,
                  std::shared_ptr<JobPromotion> promotion)
      : job_(job),
        folder_(std::move(folder)),
        attempt_(attempt),
        promotion_(std::move(promotion)) {}

  bool IsDone() const override;
  Outcome Run() override;

 private:
  v1::Job& job_;
  const std::filesystem::path folder_;
  const JobAttempt& attempt_;
  const std::shared_ptr<JobPromotion> promotion_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_RECALIBRATE_STEP_H_
