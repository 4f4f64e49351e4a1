// Counts durations from nanoseconds to hours, each precise to a tenth of a percent.

#ifndef MANEUVER_CLIENT_LOAD_LATENCY_HISTOGRAM_H_
#define MANEUVER_CLIENT_LOAD_LATENCY_HISTOGRAM_H_

#include <chrono>
#include <cstdint>
#include <vector>

namespace maneuver::load {

// A high dynamic range histogram in HdrHistogram's layout: up to 2047 ns each value has its own
// bucket; beyond that, each power of two has 1024 buckets of equal width. Every recorded value is
// known to 1/1024 of itself, extreme values too. Nothing is sampled. Not thread-safe.
class LatencyHistogram {
 public:
  // Records a duration. Negative ones count as zero, those over 2^43 ns (2.4 hours) as 2^43 ns.
  void Record(std::chrono::nanoseconds latency);

  int64_t count() const { return count_; }
  // Returns the largest value, exactly. This and the following return zero if nothing was recorded.
  std::chrono::nanoseconds max() const { return max_; }
  std::chrono::nanoseconds mean() const;
  // Returns the quantile of the recorded latencies, 0 < quantile <= 1: the upper end of the bucket
  // that contains it, but at most max().
  std::chrono::nanoseconds Quantile(double quantile) const;

 private:
  std::vector<int64_t> buckets_;  // up to the largest one needed
  int64_t count_ = 0;
  std::chrono::nanoseconds max_{0};
  double sum_ = 0.0;  // nanoseconds
};

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_LATENCY_HISTOGRAM_H_
