#include "client/overload_throttle.h"

#include <algorithm>
#include <cmath>

#include "client/error_details.h"

namespace maneuver::client {
namespace {

// Timeouts within this factor count as equal: calls may lose some time before they are sent.
constexpr double kAlike = 1.25;

}  // namespace

absl::Status OverloadThrottle::Admit(absl::Duration timeout, absl::Time now) {
  const MutexLock lock(mutex_);
  ForgetLocked(now);
  if (timeout > kAlike * refused_timeout_) return absl::OkStatus();
  const double surplus = requests_ - kSentOfAccepted * accepted_ - kFree;
  const double uniform = std::uniform_real_distribution<double>(0.0, 1.0)(random_);
  if (uniform * (requests_ + 1.0) >= surplus) return absl::OkStatus();
  requests_ += 1.0;
  return WithDetails(
      absl::ResourceExhaustedError(
          "not sent: the server has refused too many of this client's calls of late, or had no "
          "time for them; try again a little later"),
      {.reason = kHeldBack, .retry_delay = retry_delay_});
}

void OverloadThrottle::Record(const absl::Status& status, absl::Duration timeout, absl::Time now) {
  if (absl::IsUnavailable(status) || absl::IsCancelled(status)) return;
  const ErrorDetails details =
      absl::IsResourceExhausted(status) ? ErrorDetailsOf(status) : ErrorDetails();
  const MutexLock lock(mutex_);
  ForgetLocked(now);
  requests_ += 1.0;
  // An error without a delay is permanent, for example a request that is too large.
  if (!details.retry_delay && !absl::IsDeadlineExceeded(status)) {
    accepted_ += 1.0;
    return;
  }
  if (details.retry_delay) retry_delay_ = *details.retry_delay;
  if (kAlike * timeout > refused_timeout_) refused_at_ = now;
  refused_timeout_ = std::max(refused_timeout_, timeout);
}

void OverloadThrottle::ForgetLocked(absl::Time now) {
  if (now - refused_at_ > kMemory) refused_timeout_ = absl::ZeroDuration();
  if (now <= forgotten_at_) return;
  const double kept = std::exp(-absl::FDivDuration(now - forgotten_at_, kMemory));
  requests_ *= kept;
  accepted_ *= kept;
  forgotten_at_ = now;
}

}  // namespace maneuver::client
