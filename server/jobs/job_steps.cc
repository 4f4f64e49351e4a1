#include "server/jobs/job_steps.h"

#include "server/jobs/cross_validate_step.h"
#include "server/jobs/decide_step.h"
#include "server/jobs/evaluate_step.h"
#include "server/jobs/job_folder.h"
#include "server/jobs/job_promotion.h"
#include "server/jobs/learn_step.h"
#include "server/jobs/measure_step.h"
#include "server/jobs/publish_step.h"
#include "server/jobs/recalibrate_step.h"
#include "server/jobs/tag_step.h"

namespace maneuver::jobs {

JobSteps StepsOf(v1::Job& job, const std::filesystem::path& folder, const JobAttempt& attempt) {
  JobSteps steps;
  if (job.has_train() || job.has_recalibrate()) {
    const auto promotion = std::make_shared<JobPromotion>(job, folder / kPromotionFolder, attempt);
    if (job.has_train()) {
      steps.push_back(std::make_unique<LearnStep>(job, folder, attempt, promotion));
    } else {
      steps.push_back(std::make_unique<RecalibrateStep>(job, folder, attempt, promotion));
    }
    steps.push_back(std::make_unique<PublishStep>(job, folder, attempt));
    steps.push_back(std::make_unique<MeasureStep>(promotion));
    steps.push_back(std::make_unique<DecideStep>(promotion));
  } else if (job.has_cross_validate()) {
    steps.push_back(std::make_unique<CrossValidateStep>(job, folder, attempt));
  } else if (job.has_tag()) {
    steps.push_back(std::make_unique<TagStep>(job, folder, attempt));
  } else {
    steps.push_back(std::make_unique<EvaluateStep>(job, folder, attempt));
  }
  return steps;
}

}  // namespace maneuver::jobs
