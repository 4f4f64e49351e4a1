// The step of a tagging job: the trainer tags the shards of its part that are not complete.

#ifndef MANEUVER_SERVER_JOBS_TAG_STEP_H_
#define MANEUVER_SERVER_JOBS_TAG_STEP_H_

#include <filesystem>
#include <utility>

#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/job_step.h"

namespace maneuver::jobs {

// Sets job.tagged. The trainer writes complete shards straight into the tags' folder, so they
// remain if its process dies, and two attempts at once write the same bytes.
class TagStep final : public JobStep {
 public:
  // `job` and `attempt` must outlive the step.
  TagStep(v1::Job& job, std::filesystem::path folder, const JobAttempt& attempt)
      : job_(job), folder_(std::move(folder)), attempt_(attempt) {}

  bool IsDone() const override { return job_.has_tagged(); }
  Outcome Run() override;

 private:
  v1::Job& job_;
  const std::filesystem::path folder_;
  const JobAttempt& attempt_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_TAG_STEP_H_
