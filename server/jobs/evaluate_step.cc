#include "server/jobs/evaluate_step.h"

#include "server/jobs/job_requests.h"
#include "server/jobs/measurement.h"

namespace maneuver::jobs {

Outcome EvaluateStep::Run() {
  const v1::EvaluateRequest& request = job_.evaluate();
  Measured measured = Measure(job_,
                              {request.model(), request.dataset(),
                               ResolveExamples(request.examples()), request.sampled_examples()},
                              folder_, attempt_);
  if (measured.report) *job_.mutable_evaluation() = *std::move(measured.report);
  return std::move(measured.outcome);
}

}  // namespace maneuver::jobs
