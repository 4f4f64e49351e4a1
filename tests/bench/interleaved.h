// Measures the times of several things in turn in one run, so that their ratios hold even on a busy
// machine. Times are processor times of the calling thread: the time that others used its core does
// not count.

#ifndef MANEUVER_TESTS_BENCH_INTERLEAVED_H_
#define MANEUVER_TESTS_BENCH_INTERLEAVED_H_

#include <functional>
#include <string>
#include <vector>

namespace maneuver::bench {

// Returns the processor time of the calling thread so far, seconds.
double ThreadSeconds();

// Seconds of one thing in each round.
using Series = std::vector<double>;

// Returns a quantile, the lower of two in the middle. `share` in [0, 1]: 0.5 is the median.
double Quantile(Series values, double share);
inline double Median(const Series& values) { return Quantile(values, 0.5); }
// Returns a / b of each round.
Series Ratios(const Series& a, const Series& b);
// Returns the sum of each round. All series have equal lengths.
Series Sum(const std::vector<Series>& parts);

// Runs everything once in each round, until `seconds` of the clock have passed and there were at
// least `least` rounds. One round before the first is not counted: it fills caches and buffers.
//   things: timed on the calling thread; each is run in every round, in this order
std::vector<Series> MeasureInTurn(const std::vector<std::function<void()>>& things, double seconds,
                                  int least);

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_INTERLEAVED_H_
