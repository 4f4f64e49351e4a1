// The step of a training job in which the trainer learns a model.

#ifndef MANEUVER_SERVER_JOBS_LEARN_STEP_H_
#define MANEUVER_SERVER_JOBS_LEARN_STEP_H_

#include <filesystem>
#include <memory>
#include <utility>

#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/job_promotion.h"
#include "server/jobs/job_step.h"

namespace maneuver::jobs {

// Writes the model to the output folder of the job. If a process dies, the next one continues from
// its last checkpoint.
class LearnStep final : public JobStep {
 public:
  // `job` and `attempt` must outlive the step.
  LearnStep(v1::Job& job, std::filesystem::path folder, const JobAttempt& attempt,
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

#endif  // MANEUVER_SERVER_JOBS_LEARN_STEP_H_
