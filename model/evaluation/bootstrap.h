// The bootstrap: how far a figure moves when other recordings are drawn.
//
// Examples of one recording are alike, so what is drawn with replacement is groups of recordings,
// as many as there are (the cluster bootstrap; Davison and Hinkley, Bootstrap Methods and their
// Application, 1997, section 3.8). The interval is that between percentiles of the figure over the
// draws.

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

// Returns how often each group is in each draw. Each row sums to `groups`. The same seed gives the
// same draws on every machine. [resamples, groups]
Eigen::MatrixXd DrawGroups(int groups, int resamples, uint64_t seed);

// Returns the 2.5th and the 97.5th percentile, interpolated linearly between the nearest values.
// Values that are not finite do not count: of a draw that has no example of a part. Both ends are
// NaN if no value counts.
Interval PercentileInterval(std::vector<double> values);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_BOOTSTRAP_H_
