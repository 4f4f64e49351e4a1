// The step of a training or a recalibration that makes its model the next version.

#ifndef MANEUVER_SERVER_JOBS_PUBLISH_STEP_H_
#define MANEUVER_SERVER_JOBS_PUBLISH_STEP_H_

#include <filesystem>
#include <utility>

#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/job_step.h"

namespace maneuver::jobs {

// Publishes the model in the output folder of the job, and sets job.model_version.
class PublishStep final : public JobStep {
 public:
  // `job` and `attempt` must outlive the step.
  PublishStep(v1::Job& job, std::filesystem::path folder, const JobAttempt& attempt)
      : job_(job), folder_(std::move(folder)), attempt_(attempt) {}

  // Finds the version that an earlier process published before the server died.
  absl::Status Recall() override;
  bool IsDone() const override { return !job_.model_version().empty(); }
  Outcome Run() override;

 private:
  v1::Job& job_;
  const std::filesystem::path folder_;
  const JobAttempt& attempt_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_PUBLISH_STEP_H_
