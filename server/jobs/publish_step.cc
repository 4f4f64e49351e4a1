#include "server/jobs/publish_step.h"

#include <string>

#include "server/jobs/job_folder.h"
#include "server/jobs/trainer_outcome.h"
#include "server/jobs/version_request.h"

namespace maneuver::jobs {

absl::Status PublishStep::Recall() {
  const VersionRequest request = VersionRequestOf(job_);
  const auto published = attempt_.environment.versions->FindMadeBy(
      request.ModelId(), request.promotion, attempt_.maker);
  if (!published.ok()) return WithDefaultReason(published.status(), "MODEL_REFUSED");
  if (*published) job_.set_model_version((*published)->ToString());
  return absl::OkStatus();
}

Outcome PublishStep::Run() {
  const VersionRequest request = VersionRequestOf(job_);
  const auto version = attempt_.environment.versions->Publish(request.ModelId(), folder_ / kOutput,
                                                              request.promotion, attempt_.maker);
  if (!version.ok()) return {WithDefaultReason(version.status(), "MODEL_REFUSED")};
  job_.set_model_version(version->ToString());
  return {};
}

}  // namespace maneuver::jobs
