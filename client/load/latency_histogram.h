// Counts of durations, from nanoseconds to hours, each known to a tenth of a percent.

#ifndef MANEUVER_CLIENT_LOAD_LATENCY_HISTOGRAM_H_
#define MANEUVER_CLIENT_LOAD_LATENCY_HISTOGRAM_H_

#include <chrono>
#include <cstdint>
#include <vector>

namespace maneuver::load {

// A high dynamic range histogram, as HdrHistogram lays it out: up to 2047 ns each value has a
// bucket of its own, from there on each power of two has 1024 of equal width. So a recorded value
// is known within 1/1024 of itself, the extremes are found by counting to them, and nothing is
// sampled. Not thread-safe.
class LatencyHistogram {
 public:
  // Negative durations count as zero, and those over 2^43 ns (2.4 hours) as that.
  void Record(std::chrono::nanoseconds latency);

  int64_t count() const { return count_; }
  // Largest recorded, exactly. Zero if nothing was recorded, as what follows.
  std::chrono::nanoseconds max() const { return max_; }
  std::chrono::nanoseconds mean() const;
  // The least latency that at least the share `quantile` in (0, 1] of the recorded ones does not
  // exceed: the upper end of its bucket, but no more than max().
  std::chrono::nanoseconds Quantile(double quantile) const;

 private:
  std::vector<int64_t> buckets_;  // as far as they were needed
  int64_t count_ = 0;
  std::chrono::nanoseconds max_{0};
  double sum_ = 0.0;  // nanoseconds
};

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_LATENCY_HISTOGRAM_H_
