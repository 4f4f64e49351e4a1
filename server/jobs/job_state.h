// The states of a job and the moves between them.

#ifndef MANEUVER_SERVER_JOBS_JOB_STATE_H_
#define MANEUVER_SERVER_JOBS_JOB_STATE_H_

#include <array>
#include <string_view>

#include "maneuver/v1/training_service.pb.h"

namespace maneuver::jobs {

inline constexpr std::array kJobStates = {v1::JOB_STATE_PENDING, v1::JOB_STATE_RUNNING,
                                          v1::JOB_STATE_SUCCEEDED, v1::JOB_STATE_FAILED,
                                          v1::JOB_STATE_CANCELLED};

// Returns whether a job may move from one state to the other.
bool CanMove(v1::JobState from, v1::JobState to);

// Returns whether a Resume request may make a job in this state PENDING again.
bool CanResume(v1::JobState state);

// Returns whether a job in this state has ended: only a request can move it on.
bool HasEnded(v1::JobState state);

// Returns "pending", "running" and so on, for metrics, logs and messages.
std::string_view JobStateLabel(v1::JobState state);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_STATE_H_
