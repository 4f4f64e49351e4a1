// Measures how the cost of an answer grows with the size of the request.

#ifndef MANEUVER_TESTS_BENCH_CURVES_H_
#define MANEUVER_TESTS_BENCH_CURVES_H_

#include <string>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "tests/bench/bench_model.h"
#include "tests/bench/picture.h"

namespace maneuver::bench {

// Microseconds per target as a function of some quantity.
struct GrowthCurve {
  std::string file;  // of its picture, without folder
  Chart chart;
};

struct GrowthOptions {
  double seconds = 10.0;  // of each curve
  int rounds = 9;         // at least
  int most_targets = 1'000;
};

// Measures over the numbers of targets, agents, map points and requested actions. Scenes have
// kLargestBatch targets each.
std::vector<GrowthCurve> MeasureGrowth(const BenchModel& model,
                                       const std::vector<v1::Scenario>& scenes,
                                       const GrowthOptions& options);

// The straight line that fits a curve by least squares.
struct StraightLine {
  double constant = 0.0;
  double slope = 0.0;
  double furthest = 0.0;  // of the points' departures from it, a share of the point's y
};
StraightLine FitLine(const std::vector<double>& x, const std::vector<double>& y);

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_CURVES_H_
