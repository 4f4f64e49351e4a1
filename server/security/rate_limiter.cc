#include "server/security/rate_limiter.h"

#include <algorithm>
#include <utility>

namespace maneuver::security {

RateLimiter::RateLimiter(double per_second, std::function<SteadyTime()> clock)
    : per_second_(per_second), clock_(std::move(clock)) {}

std::optional<std::chrono::nanoseconds> RateLimiter::Take(const std::string& client,
                                                          double amount) {
  if (!is_limited()) return std::nullopt;
  const double capacity = std::max(per_second_, 1.0);
  const MutexLock lock(mutex_);
  const SteadyTime now = clock_();
  if (const auto known = by_client_.find(client); known != by_client_.end()) {
    buckets_.splice(buckets_.begin(), buckets_, known->second);
  } else {
    if (buckets_.size() == kMaxClients) {
      by_client_.erase(buckets_.back().client);
      buckets_.pop_back();
    }
    buckets_.push_front({client, capacity, now});
    by_client_.emplace(client, buckets_.begin());
  }
  Bucket& bucket = buckets_.front();
  const double seconds = std::chrono::duration<double>(now - bucket.updated).count();
  bucket.level = std::min(capacity, bucket.level + seconds * per_second_);
  bucket.updated = now;
  // Whole units, so that a caller that waits exactly as long as told finds one.
  constexpr double kRounding = 1e-6;
  if (bucket.level < 1.0 - kRounding) {
    return std::chrono::ceil<std::chrono::nanoseconds>(
        std::chrono::duration<double>((1.0 - bucket.level) / per_second_));
  }
  bucket.level -= amount;
  return std::nullopt;
}

size_t RateLimiter::clients() const {
  const MutexLock lock(mutex_);
  return buckets_.size();
}

}  // namespace maneuver::security
