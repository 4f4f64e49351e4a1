// The step of a cross-validation job: the trainer learns and measures a model for each fold.

#ifndef MANEUVER_SERVER_JOBS_CROSS_VALIDATE_STEP_H_
#define MANEUVER_SERVER_JOBS_CROSS_VALIDATE_STEP_H_

#include <filesystem>
#include <utility>

#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/job_step.h"

namespace maneuver::jobs {

// Sets job.cross_validation. If a process dies, its measurements remain as checkpoints.
class CrossValidateStep final : public JobStep {
 public:
  // `job` and `attempt` must outlive the step.
  CrossValidateStep(v1::Job& job, std::filesystem::path folder, const JobAttempt& attempt)
      : job_(job), folder_(std::move(folder)), attempt_(attempt) {}

  bool IsDone() const override { return job_.has_cross_validation(); }
  Outcome Run() override;

 private:
  v1::Job& job_;
  const std::filesystem::path folder_;
  const JobAttempt& attempt_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_CROSS_VALIDATE_STEP_H_
