// Private to the library: protects a server that has too much to do. Calls that it would refuse are
// refused here, where that costs the server nothing. It can then answer others in that time.
//
// Client-side throttling after Beyer et al., Site Reliability Engineering (2016), chapter 21. Of a
// client's recent calls, `requests` were made, and `accepted` were neither refused nor timed out.
// The next call is held back with probability (requests - K accepted - kFree) / (requests + 1). The
// client thus sends about K times as many calls as are accepted, and notices when more are.

#ifndef MANEUVER_CLIENT_OVERLOAD_THROTTLE_H_
#define MANEUVER_CLIENT_OVERLOAD_THROTTLE_H_

#include <random>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/time/time.h"
#include "locks/mutex.h"

namespace maneuver::client {

// Thread-safe.
class OverloadThrottle {
 public:
  // K: calls sent for each accepted one. 2 is usual where a refusal costs almost nothing. Here
  // about three refusals of calls with a whole map cost as much as one answer about one vehicle.
  static constexpr double kSentOfAccepted = 1.2;
  // This many calls may be refused without consequence, so that occasional callers are never held
  // back.
  static constexpr double kFree = 3.0;
  // The retry delay of a call held back before the server has stated one.
  static constexpr absl::Duration kDelay = absl::Milliseconds(50);
  // What counts as recent: the weight of a call decays to 1/e in this time.
  static constexpr absl::Duration kMemory = absl::Seconds(2);

  explicit OverloadThrottle(uint64_t seed = std::random_device{}()) : random_(seed) {}

  // Returns OK if a call with this timeout may be sent. Otherwise returns RESOURCE_EXHAUSTED,
  // HELD_BACK, with the delay that the server last asked for. A call whose timeout is more than
  // 1.25 times that of any call refused lately is always sent.
  absl::Status Admit(absl::Duration timeout, absl::Time now);

  // Records how an admitted call ended. A call that did not reach the server does not count. A call
  // that timed out does: a server with more to read than it can handle refuses nothing.
  void Record(const absl::Status& status, absl::Duration timeout, absl::Time now);

 private:
  void ForgetLocked(absl::Time now) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  Mutex mutex_;
  std::mt19937_64 random_ ABSL_GUARDED_BY(mutex_);
  double requests_ ABSL_GUARDED_BY(mutex_) = 0.0;
  double accepted_ ABSL_GUARDED_BY(mutex_) = 0.0;
  absl::Time forgotten_at_ ABSL_GUARDED_BY(mutex_) = absl::InfinitePast();
  // The longest timeout among recent calls that were not accepted.
  absl::Duration refused_timeout_ ABSL_GUARDED_BY(mutex_) = absl::ZeroDuration();
  absl::Time refused_at_ ABSL_GUARDED_BY(mutex_) = absl::InfinitePast();
  absl::Duration retry_delay_ ABSL_GUARDED_BY(mutex_) = kDelay;  // that the server last asked for
};

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_OVERLOAD_THROTTLE_H_
