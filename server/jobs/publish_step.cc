#include "server/jobs/publish_step.h"

#include <string>

#include "absl/strings/strip.h"
#include "server/jobs/job_folder.h"
#include "server/jobs/trainer_outcome.h"

namespace maneuver::jobs {
namespace {

std::string ModelId(const v1::TrainRequest& request) {
  return std::string(absl::StripPrefix(request.model(), "models/"));
}

}  // namespace

absl::Status PublishStep::Recall() {
  const auto published = attempt_.environment.versions->FindMadeBy(
      ModelId(job_.train()), job_.train().promotion(), attempt_.maker);
  if (!published.ok()) return WithDefaultReason(published.status(), "MODEL_REFUSED");
  if (*published) job_.set_model_version((*published)->ToString());
  return absl::OkStatus();
}

Outcome PublishStep::Run() {
  const auto version = attempt_.environment.versions->Publish(
      ModelId(job_.train()), folder_ / kOutput, job_.train().promotion(), attempt_.maker);
  if (!version.ok()) return {WithDefaultReason(version.status(), "MODEL_REFUSED")};
  job_.set_model_version(version->ToString());
  return {};
}

}  // namespace maneuver::jobs
