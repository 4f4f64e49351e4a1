// Times of things that are measured in turn in one run, so that their ratios hold on a machine that
// has other things to do as well. Times are of the calling thread on its core: what others had of
// the core in between does not count.

#ifndef MANEUVER_TESTS_BENCH_INTERLEAVED_H_
#define MANEUVER_TESTS_BENCH_INTERLEAVED_H_

#include <functional>
#include <string>
#include <vector>

namespace maneuver::bench {

// Processor time of the calling thread so far, seconds.
double ThreadSeconds();

// Seconds of one thing in each round.
using Series = std::vector<double>;

// The middle one; the lower of two. `share` in [0, 1]: 0.5 is the median.
double Quantile(Series values, double share);
inline double Median(const Series& values) { return Quantile(values, 0.5); }
// a / b of each round.
Series Ratios(const Series& a, const Series& b);
// The sum of each round; all are as long.
Series Sum(const std::vector<Series>& parts);

// Rounds in which everything is run once, until `seconds` (of the clock) have passed and there were
// `least` of them. One round before the first is not counted: it fills caches and buffers.
//   things: what is timed, on the calling thread alone; each is run in every round, in this order.
std::vector<Series> MeasureInTurn(const std::vector<std::function<void()>>& things, double seconds,
                                  int least);

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_INTERLEAVED_H_
