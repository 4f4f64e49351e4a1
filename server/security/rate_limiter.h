// Limits how often each client may call.

#ifndef MANEUVER_SERVER_SECURITY_RATE_LIMITER_H_
#define MANEUVER_SERVER_SECURITY_RATE_LIMITER_H_

#include <chrono>
#include <functional>
#include <list>
#include <optional>
#include <string>
#include <unordered_map>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"

namespace maneuver::security {

using SteadyTime = std::chrono::steady_clock::time_point;

// A token bucket for each client, which holds the tokens of one second (at least 1). A client that
// has one token may take any amount, and then waits until it has one again. So a request for a
// thousand targets at a limit of a hundred per second is admitted once in ten seconds.
//
// Remembers at most kMaxClients; beyond that, the client that has been away longest starts with a
// full bucket. Thread-safe.
class RateLimiter {
 public:
  static constexpr size_t kMaxClients = 10'000;

  //   per_second: 0 for no limit.
  explicit RateLimiter(double per_second,
                       std::function<SteadyTime()> clock = std::chrono::steady_clock::now);

  bool is_limited() const { return per_second_ > 0.0; }

  // Takes `amount` from the client's bucket and returns nothing. If the bucket holds less than one
  // token, leaves it alone and returns the time until it holds one.
  std::optional<std::chrono::nanoseconds> Take(const std::string& client, double amount);

  size_t clients() const;

 private:
  struct Bucket {
    std::string client;
    double level = 0.0;
    SteadyTime updated;
  };

  const double per_second_;
  const std::function<SteadyTime()> clock_;
  mutable Mutex mutex_;
  std::list<Bucket> buckets_ ABSL_GUARDED_BY(mutex_);  // most recently used first
  std::unordered_map<std::string, std::list<Bucket>::iterator> by_client_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace maneuver::security

#endif  // MANEUVER_SERVER_SECURITY_RATE_LIMITER_H_
