// Retries when a server cannot be reached for a moment.

#ifndef MANEUVER_CLIENT_RETRY_H_
#define MANEUVER_CLIENT_RETRY_H_

#include <functional>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/cancellation.h"

namespace maneuver::client {

// When and how often to retry a call that failed with UNAVAILABLE or was broken off. No other code
// is retried.
struct RetryPolicy {
  int max_attempts = 4;  // the first one included; 1: never retry
  absl::Duration initial_backoff = absl::Milliseconds(100);
  double backoff_multiplier = 2.0;
  absl::Duration max_backoff = absl::Seconds(5);
  double jitter = 0.2;  // each wait is longer or shorter by up to this share, in [0, 1]
};

// Returns how long to wait after failure number `failures` (from 1).
//   uniform: decides the jitter, in [0, 1).
absl::Duration BackoffAfter(const RetryPolicy& policy, int failures, double uniform);

// Called before each wait, with the failure and the time until the next attempt.
using OnRetry = std::function<void(const absl::Status& failure, absl::Duration wait)>;

// Calls `attempt` until it returns anything but UNAVAILABLE, the attempts are used up, or the next
// wait would pass `deadline`. Returns the result of the last attempt. A retry delay in the error's
// details extends the wait. CANCELLED if cancelled meanwhile.
//   deadline: `attempt` may move it
//   cancellation, on_retry: may be null.
absl::Status RetryUnavailable(const RetryPolicy& policy, const absl::Time& deadline,
                              const Cancellation* cancellation, const OnRetry& on_retry,
                              const std::function<absl::Status()>& attempt);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_RETRY_H_
