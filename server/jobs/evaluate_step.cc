#include "server/jobs/evaluate_step.h"

#include <utility>

#include "server/jobs/job_settings.h"
#include "server/jobs/measurement.h"

namespace maneuver::jobs {

Outcome EvaluateStep::Run() {
  const v1::EvaluateRequest& request = job_.evaluate();
  absl::Status status = EnsureSettings(job_, *attempt_.environment.versions, folder_);
  if (!status.ok()) return {std::move(status)};
  Measured measured = Measure(
      job_, {request.model(), request.dataset(), request.sampled_examples()}, folder_, attempt_);
  if (measured.report) *job_.mutable_evaluation() = *std::move(measured.report);
  return std::move(measured.outcome);
}

}  // namespace maneuver::jobs
