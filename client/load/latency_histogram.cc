#include "client/load/latency_histogram.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace maneuver::load {
namespace {

constexpr int kSignificantBits = 11;
constexpr uint64_t kHalf = uint64_t{1} << (kSignificantBits - 1);
constexpr int64_t kLargest = int64_t{1} << 43;

// Returns how many low bits a value of this size loses.
int Shift(uint64_t value) {
  return std::max(0, static_cast<int>(std::bit_width(value)) - kSignificantBits);
}

size_t BucketOf(uint64_t value) {
  const int shift = Shift(value);
  return static_cast<size_t>(static_cast<uint64_t>(shift) * kHalf + (value >> shift));
}

// Returns the largest value of a bucket.
int64_t UpperEnd(size_t bucket) {
  if (bucket < 2 * kHalf) return static_cast<int64_t>(bucket);
  const uint64_t shift = bucket / kHalf - 1;
  const uint64_t kept = bucket - shift * kHalf;
  return static_cast<int64_t>(((kept + 1) << shift) - 1);
}

}  // namespace

void LatencyHistogram::Record(std::chrono::nanoseconds latency) {
  const int64_t value = std::clamp<int64_t>(latency.count(), 0, kLargest);
  const size_t bucket = BucketOf(static_cast<uint64_t>(value));
  if (bucket >= buckets_.size()) buckets_.resize(bucket + 1);
  ++buckets_[bucket];
  ++count_;
  max_ = std::max(max_, std::chrono::nanoseconds(value));
  sum_ += static_cast<double>(value);
}

std::chrono::nanoseconds LatencyHistogram::mean() const {
  if (count_ == 0) return std::chrono::nanoseconds(0);
  return std::chrono::nanoseconds(std::llround(sum_ / static_cast<double>(count_)));
}

std::chrono::nanoseconds LatencyHistogram::Quantile(double quantile) const {
  // Rounding must not ask for one more than 0.99 * 100 = 99.
  const auto wanted = static_cast<int64_t>(
      std::ceil(std::clamp(quantile, 0.0, 1.0) * static_cast<double>(count_) - 1e-6));
  int64_t seen = 0;
  for (size_t bucket = 0; bucket < buckets_.size(); ++bucket) {
    seen += buckets_[bucket];
    if (seen >= std::max<int64_t>(wanted, 1)) {
      return std::min(std::chrono::nanoseconds(UpperEnd(bucket)), max_);
    }
  }
  return max_;
}

}  // namespace maneuver::load
