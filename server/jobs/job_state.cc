#include "server/jobs/job_state.h"

#include <algorithm>

namespace maneuver::jobs {
namespace {

struct Move {
  v1::JobState from;
  v1::JobState to;
};

// Everything that is allowed; whatever is not here is not.
constexpr std::array kMoves = {
    Move{v1::JOB_STATE_PENDING, v1::JOB_STATE_RUNNING},    // its turn has come
    Move{v1::JOB_STATE_PENDING, v1::JOB_STATE_CANCELLED},  // before its turn
    Move{v1::JOB_STATE_RUNNING, v1::JOB_STATE_SUCCEEDED},
    Move{v1::JOB_STATE_RUNNING, v1::JOB_STATE_FAILED},
    Move{v1::JOB_STATE_RUNNING, v1::JOB_STATE_CANCELLED},
    Move{v1::JOB_STATE_RUNNING, v1::JOB_STATE_PENDING},    // its process died; it goes on
    Move{v1::JOB_STATE_FAILED, v1::JOB_STATE_PENDING},     // resumed by request
    Move{v1::JOB_STATE_CANCELLED, v1::JOB_STATE_PENDING},  // resumed by request
};

}  // namespace

bool CanMove(v1::JobState from, v1::JobState to) {
  return std::ranges::any_of(kMoves,
                             [&](const Move& move) { return move.from == from && move.to == to; });
}

bool CanResume(v1::JobState state) {
  return state != v1::JOB_STATE_RUNNING && CanMove(state, v1::JOB_STATE_PENDING);
}

bool HasEnded(v1::JobState state) { return state == v1::JOB_STATE_SUCCEEDED || CanResume(state); }

std::string_view JobStateLabel(v1::JobState state) {
  switch (state) {
    case v1::JOB_STATE_PENDING:
      return "pending";
    case v1::JOB_STATE_RUNNING:
      return "running";
    case v1::JOB_STATE_SUCCEEDED:
      return "succeeded";
    case v1::JOB_STATE_FAILED:
      return "failed";
    case v1::JOB_STATE_CANCELLED:
      return "cancelled";
    default:
      return "unknown";
  }
}

}  // namespace maneuver::jobs
