// Decides whether a call is admitted: whether its deadline leaves enough time for its wait and its
// work.

#ifndef MANEUVER_SERVER_SERVING_ADMISSION_H_
#define MANEUVER_SERVER_SERVING_ADMISSION_H_

#include <chrono>

#include "absl/status/status.h"

namespace maneuver::serving {

// How long a waiting call is expected to take.
struct ExpectedWait {
  std::chrono::nanoseconds wait;  // until its work begins
  std::chrono::nanoseconds work;  // its own
  // The time since the queue was last empty exceeds the time that the call has left.
  bool standing;
};

// Returns RESOURCE_EXHAUSTED with reason DEADLINE_TOO_CLOSE and a retry delay if a call needs more
// than `left`, the time until its deadline. The expected times count with a margin, and a standing
// queue with a larger one.
absl::Status CheckTimeLeft(const ExpectedWait& expected, std::chrono::nanoseconds left);

// Returns `delay` clamped to what callers are told: a millisecond to half a minute.
std::chrono::nanoseconds RetryDelay(std::chrono::nanoseconds delay);

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_ADMISSION_H_
