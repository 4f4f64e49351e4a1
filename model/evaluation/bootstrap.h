// The bootstrap: how much a figure varies when other recordings are drawn.
//
// Examples of one recording resemble each other. Therefore groups of recordings are drawn with
// replacement, as many as there are (the cluster bootstrap; Davison and Hinkley, Bootstrap Methods
// and their Application, 1997, section 3.8). An interval reaches from one percentile of the figure
// over the draws to another.

#ifndef MANEUVER_MODEL_EVALUATION_BOOTSTRAP_H_
#define MANEUVER_MODEL_EVALUATION_BOOTSTRAP_H_

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace maneuver::evaluation {

struct Interval {
  double lower = 0.0;
  double upper = 0.0;
};

// Returns how often each draw contains each group, [resamples, groups]. Each row sums to `groups`.
// The same seed gives the same draws on every machine.
Eigen::MatrixXd DrawGroups(int groups, int resamples, uint64_t seed);

// Returns the 2.5th and the 97.5th percentile, interpolated linearly between the nearest values.
// Ignores values that are not finite, which come from draws without an example of a part. Both ends
// are NaN if no value remains.
Interval PercentileInterval(std::vector<double> values);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_BOOTSTRAP_H_
