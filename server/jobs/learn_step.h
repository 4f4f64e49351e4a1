// The step of a training job in which the trainer learns a model.

#ifndef MANEUVER_SERVER_JOBS_LEARN_STEP_H_
#define MANEUVER_SERVER_JOBS_LEARN_STEP_H_

#include <filesystem>
#include <utility>

#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/job_step.h"

namespace maneuver::jobs {

// Leaves the model in the output of the job's folder. A process that dies leaves its checkpoints:
// the next one goes on from the last of them.
class LearnStep final : public JobStep {
 public:
  // `job` and `attempt` outlive the step.
  LearnStep(v1::Job& job, std::filesystem::path folder, const JobAttempt& attempt)
      : job_(job), folder_(std::move(folder)), attempt_(attempt) {}

  bool IsDone() const override;
  Outcome Run() override;

 private:
  v1::Job& job_;
  const std::filesystem::path folder_;
  const JobAttempt& attempt_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_LEARN_STEP_H_
