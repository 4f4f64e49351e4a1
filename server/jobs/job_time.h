#ifndef MANEUVER_SERVER_JOBS_JOB_TIME_H_
#define MANEUVER_SERVER_JOBS_JOB_TIME_H_

#include <google/protobuf/util/time_util.h>

#include "absl/time/time.h"

namespace maneuver::jobs {

inline google::protobuf::Timestamp ToTimestamp(absl::Time time) {
  return google::protobuf::util::TimeUtil::NanosecondsToTimestamp(absl::ToUnixNanos(time));
}

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_TIME_H_
