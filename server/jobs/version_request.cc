#include "server/jobs/version_request.h"

#include "server/security/resource_name.h"

namespace maneuver::jobs {

std::string VersionRequest::ModelId() const { return security::IdOf(model); }

VersionRequest VersionRequestOf(const v1::Job& job) {
  if (!job.has_recalibrate()) {
    const v1::TrainRequest& train = job.train();
    return {train.model(), train.promotion(), train.promotion_criteria()};
  }
  const v1::RecalibrateRequest& recalibrate = job.recalibrate();
  const std::string& version = recalibrate.model();  // models/{model}/versions/{version}
  return {version.substr(0, version.find("/versions/")), recalibrate.promotion(),
          recalibrate.promotion_criteria()};
}

}  // namespace maneuver::jobs
