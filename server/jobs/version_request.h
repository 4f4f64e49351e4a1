// What a job that makes a version asks for, whether it trains or recalibrates.

#ifndef MANEUVER_SERVER_JOBS_VERSION_REQUEST_H_
#define MANEUVER_SERVER_JOBS_VERSION_REQUEST_H_

#include <string>

#include "maneuver/v1/training_service.pb.h"

namespace maneuver::jobs {

struct VersionRequest {
  std::string model;  // models/{model} that gets the version
  v1::Promotion promotion = v1::PROMOTION_UNSPECIFIED;
  v1::PromotionCriteria criteria;

  std::string ModelId() const;  // {model}
};

// `job` must be a training or a recalibration that was admitted.
VersionRequest VersionRequestOf(const v1::Job& job);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_VERSION_REQUEST_H_
