// The promotion of the version that a job made. Gives the decision its versions and reports, and
// keeps the decision in the job's folder.

#ifndef MANEUVER_SERVER_JOBS_JOB_PROMOTION_H_
#define MANEUVER_SERVER_JOBS_JOB_PROMOTION_H_

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/job_attempt.h"
#include "server/jobs/promotion.h"
#include "server/jobs/version_request.h"

namespace maneuver::jobs {

// Sets job.promotion_decision to "not promoted" because of `why`, decided at `now`.
void DecideAgainstPromotion(v1::Job& job, const absl::Status& why, absl::Time now);

class JobPromotion final : public PromotionVersions {
 public:
  // `job` must be a training or a recalibration. `job` and `attempt` must outlive this object.
  // Measurements run in `folder`, which is created when it is needed.
  JobPromotion(v1::Job& job, std::filesystem::path folder, const JobAttempt& attempt);

  bool HasVersion() const { return !job_.model_version().empty(); }
  bool IsDecided() const { return job_.has_promotion_decision(); }
  // Returns whether measurements decide, which they do with PROMOTION_IF_NO_WORSE.
  bool IsByMeasurement() const { return request_.promotion == v1::PROMOTION_IF_NO_WORSE; }
  // Returns the decision to make. Errors: those of DatasetStore::Read for the criteria's dataset,
  // with the reason UNUSABLE_DATA.
  absl::StatusOr<PromotionTask> Task() const;

  // Returns options (--next-..., trainer_protocol.h) that let the progress of the training count
  // the measurements that follow it. The trainer estimates their time with the version that serves.
  // Writes the settings file that they name. Empty if no measurement follows, or nothing serves.
  std::vector<std::string> TrainerOptions();

  // Sets job.promotion_decision to what publishing did.
  void DecideAsPublished();
  // Sets job.promotion_decision to "not promoted" because of `why`.
  void DecideAgainst(const absl::Status& why);
  // Sets job.promotion_decision to the decision of `outcome`. If `outcome` has none, returns the
  // error that interrupted it, or OK if the decision is not due yet.
  Outcome Conclude(PromotionOutcome outcome);

  std::string Serving() override;
  absl::StatusOr<v1::EvaluationReport> FindReport(const std::string& version) override;
  MeasuredVersion Measure(const std::string& version) override;
  absl::StatusOr<bool> Promote(const std::string& version, const std::string& before) override;
  absl::Status Remember(const v1::PromotionDecision& decision) override;
  std::optional<v1::PromotionDecision> Remembered() override;

 private:
  v1::Job& job_;
  const std::filesystem::path folder_;
  const JobAttempt& attempt_;
  const VersionRequest request_;
  const v1::PromotionCriteria criteria_;  // complete
  // Reports that this attempt made, by version. They stay here if their version is deleted.
  std::map<std::string, v1::EvaluationReport> measured_;
  bool last_died_ = false;  // whether the process that measured last died
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_PROMOTION_H_
