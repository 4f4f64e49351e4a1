#include "client/retry.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "absl/time/clock.h"
#include "client/error_details.h"

namespace maneuver::client {
namespace {

double Uniform() {
  thread_local std::mt19937_64 engine{std::random_device{}()};
  return std::uniform_real_distribution<double>(0.0, 1.0)(engine);
}

}  // namespace

absl::Duration BackoffAfter(const RetryPolicy& policy, int failures, double uniform) {
  const absl::Duration nominal = std::min(
      policy.initial_backoff * std::pow(policy.backoff_multiplier, std::max(failures, 1) - 1),
      policy.max_backoff);
  return nominal * (1.0 + policy.jitter * (2.0 * uniform - 1.0));
}

absl::Status RetryUnavailable(const RetryPolicy& policy, const absl::Time& deadline,
                              const Cancellation* cancellation, const OnRetry& on_retry,
                              const std::function<absl::Status()>& attempt) {
  for (int failures = 1;; ++failures) {
    absl::Status status = attempt();
    if (!absl::IsUnavailable(status) || failures >= policy.max_attempts) return status;
    absl::Duration wait = BackoffAfter(policy, failures, Uniform());
    if (const auto asked = ErrorDetailsOf(status).retry_delay) wait = std::max(wait, *asked);
    if (absl::Now() + wait >= deadline) return status;
    if (on_retry) on_retry(status, wait);
    if (cancellation == nullptr) {
      absl::SleepFor(wait);
    } else if (!cancellation->Sleep(wait)) {
      return absl::CancelledError("the call was cancelled");
    }
  }
}

}  // namespace maneuver::client
