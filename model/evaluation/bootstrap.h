// The bootstrap and the jackknife: how much a figure varies when other recordings are drawn.
//
// Examples of one recording resemble each other. Therefore groups of recordings are drawn with
// replacement, as many as there are (the cluster bootstrap; Davison and Hinkley, Bootstrap Methods
// and their Application, 1997, section 3.8). An interval reaches from one percentile of the figure
// over the draws to another.

#ifndef MANEUVER_MODEL_EVALUATION_BOOTSTRAP_H_
#define MANEUVER_MODEL_EVALUATION_BOOTSTRAP_H_

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

namespace maneuver::evaluation {

struct Interval {
  double lower = 0.0;
  double upper = 0.0;
};

// Draws are made from at most this many groups. Groups whose numbers are equal modulo this are
// drawn together: the intervals stay valid, and the memory stays bounded.
inline constexpr int kMostDrawnGroups = 4096;

// Returns how often each draw contains each group, [resamples, groups]. Each row sums to `groups`.
// The same seed gives the same draws on every machine.
Eigen::MatrixXd DrawGroups(int groups, int resamples, uint64_t seed);

// Returns the 2.5th and the 97.5th percentile, interpolated linearly between the nearest values.
// Ignores values that are not finite, which come from draws without an example of a part. Both ends
// are NaN if no value remains.
Interval PercentileInterval(std::vector<double> values);

// Returns the jackknife's standard error of a figure (Efron and Stein, The Jackknife Estimate of
// Variance, 1981, equation 1.3): sqrt((G - 1) / G sum (v_g - mean v)^2).
//   without: the figure without each of the G groups in turn; at least two
double JackknifeError(std::span<const double> without);

// Returns the jackknife's 95 % interval of a figure, value +- 1.96 standard errors.
//   without: as above
Interval JackknifeInterval(double value, std::span<const double> without);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_BOOTSTRAP_H_
