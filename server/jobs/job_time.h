#ifndef MANEUVER_SERVER_JOBS_JOB_TIME_H_
#define MANEUVER_SERVER_JOBS_JOB_TIME_H_

#include <google/protobuf/util/time_util.h>

#include "absl/time/time.h"

// Converts the times and durations of jobs between Abseil's types and protobuf's, in nanoseconds.
namespace maneuver::jobs {

inline google::protobuf::Timestamp ToTimestamp(absl::Time time) {
  return google::protobuf::util::TimeUtil::NanosecondsToTimestamp(absl::ToUnixNanos(time));
}

inline absl::Time ToTime(const google::protobuf::Timestamp& time) {
  return absl::FromUnixNanos(google::protobuf::util::TimeUtil::TimestampToNanoseconds(time));
}

inline google::protobuf::Duration ToProto(absl::Duration duration) {
  return google::protobuf::util::TimeUtil::NanosecondsToDuration(
      absl::ToInt64Nanoseconds(duration));
}

inline absl::Duration ToDuration(const google::protobuf::Duration& duration) {
  return absl::Nanoseconds(google::protobuf::util::TimeUtil::DurationToNanoseconds(duration));
}

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_TIME_H_
