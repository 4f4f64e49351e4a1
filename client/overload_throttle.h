// Private to the library: spares a server that has more to do than it can. What it would refuse is
// refused here, where that costs it nothing: by the server's time for saying no it answers others.
//
// Client-side throttling of Beyer et al., Site Reliability Engineering (2016), chapter 21: of a
// client's calls of late, `requests` were made, and `accepted` were neither refused nor ran out of
// time; the next one is held back with probability (requests - K accepted) / (requests + 1). So a
// client sends about K times as many as are accepted, and finds out by itself when more are.

#ifndef MANEUVER_CLIENT_OVERLOAD_THROTTLE_H_
#define MANEUVER_CLIENT_OVERLOAD_THROTTLE_H_

#include <mutex>
#include <random>

#include "absl/status/status.h"
#include "absl/time/time.h"

namespace maneuver::client {

// Thread-safe.
class OverloadThrottle {
 public:
  // Sent for each that is accepted. Twice is usual where a refusal costs next to nothing; here
  // three or so, of calls with a whole map in them, cost as much as an answer about a single
  // vehicle.
  static constexpr double kSentOfAccepted = 1.2;
  // So many more than that may be refused at no consequence: nobody who asks now and then is held
  // back.
  static constexpr double kFree = 3.0;
  // What who is held back is told until the server has said how long.
  static constexpr absl::Duration kDelay = absl::Milliseconds(50);
  // What "of late" is: a call counts for less and less, 1/e of it after this.
  static constexpr absl::Duration kMemory = absl::Seconds(2);

  explicit OverloadThrottle(uint64_t seed = std::random_device{}()) : random_(seed) {}

  // OK to send a call that may take so long; or else what its caller is told: RESOURCE_EXHAUSTED,
  // HELD_BACK, with the delay that the server asked for last. That a call with little time was
  // refused says nothing of one that can wait longer, which is sent.
  absl::Status Admit(absl::Duration timeout, absl::Time now);

  // How a call ended that was admitted. One that did not reach the server says nothing of it. One
  // that ran out of time does: a server may have more to read than it can, and refuse nothing.
  void Record(const absl::Status& status, absl::Duration timeout, absl::Time now);

 private:
  void ForgetLocked(absl::Time now);

  std::mutex mutex_;  // guards what follows
  std::mt19937_64 random_;
  double requests_ = 0.0;
  double accepted_ = 0.0;
  absl::Time forgotten_at_ = absl::InfinitePast();
  // The longest that a call had that was not accepted of late.
  absl::Duration refused_timeout_ = absl::ZeroDuration();
  absl::Time refused_at_ = absl::InfinitePast();
  absl::Duration retry_delay_ = kDelay;  // that was asked for last
};

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_OVERLOAD_THROTTLE_H_
