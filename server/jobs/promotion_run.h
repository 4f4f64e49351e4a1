// The promotion of what a job has trained, as part of the job.

#ifndef MANEUVER_SERVER_JOBS_PROMOTION_RUN_H_
#define MANEUVER_SERVER_JOBS_PROMOTION_RUN_H_

#include <filesystem>

#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/trainer_run.h"

namespace maneuver::jobs {

// In a job's folder: what its promotion is decided by.
inline constexpr char kPromotionFolder[] = "promotion";

// Decides about job.model_version as job.train says, carries that out, and sets
// job.promotion_decision. Publishing has done so already but for PROMOTION_IF_NO_WORSE, which may
// measure versions in `folder`. Without a decision, the outcome says what came in between: another
// attempt is to go on.
Outcome RunPromotion(v1::Job& job, const std::filesystem::path& folder, const JobAttempt& attempt);

// Sets job.promotion_decision: not promoted, since `why`.
void DecideAgainst(v1::Job& job, const absl::Status& why, absl::Time now);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_PROMOTION_RUN_H_
