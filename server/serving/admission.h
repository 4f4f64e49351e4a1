// Whether a call is let in: whether its deadline leaves the time that it will wait and take.

#ifndef MANEUVER_SERVER_SERVING_ADMISSION_H_
#define MANEUVER_SERVER_SERVING_ADMISSION_H_

#include <chrono>

#include "absl/status/status.h"

namespace maneuver::serving {

// What is expected of a call that has to wait.
struct ExpectedWait {
  std::chrono::nanoseconds wait;  // until it is begun
  std::chrono::nanoseconds work;  // that it is itself
  // The queue has been there for longer than the call has left.
  bool standing;
};

// RESOURCE_EXHAUSTED, DEADLINE_TOO_CLOSE with the delay after which to come again, for a call that
// has no more than `left` until its deadline and needs more.
absl::Status CheckTimeLeft(const ExpectedWait& expected, std::chrono::nanoseconds left);

// A delay that a caller may be told: at least a millisecond, at most half a minute.
std::chrono::nanoseconds RetryDelay(std::chrono::nanoseconds delay);

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_ADMISSION_H_
