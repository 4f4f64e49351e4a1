#include "model/data/argoverse/motion_fit.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace maneuver::data {
namespace {

using scene::Point2;

constexpr double kWindow = 1.5;     // seconds of positions that a fit reads
constexpr double kLineBelow = 1.0;  // seconds of positions below which a line is fitted
constexpr double kFirst = 0.5;      // seconds after the beginning that share one line
constexpr double kJitter = 0.02;    // of the clock, seconds

// Returns the slope at time `now` of the polynomial fitted to values at times.
//   weights: [N] the contribution of each value
// The slope of a least squares fit is linear in the values. With the orthogonal polynomials
// 1, u, u^2 - a u - b over the times u from their mean, it is the sum of each one's slope times its
// product with the values, by its square.
std::vector<double> SlopeWeights(std::span<const double> times, double now, bool parabola) {
  const auto count = static_cast<double>(times.size());
  double mean = 0.0;
  for (const double time : times) mean += time / count;
  double s2 = 0.0, s3 = 0.0;
  for (const double time : times) {
    const double u = time - mean;
    s2 += u * u;
    s3 += u * u * u;
  }
  std::vector<double> weights;
  if (!(s2 > 0.0)) return std::vector<double>(times.size(), 0.0);
  const double a = s3 / s2;
  const double b = s2 / count;
  const auto second = [a, b](double u) { return u * u - a * u - b; };
  double square = 0.0;  // of the second polynomial
  for (const double time : times) square += second(time - mean) * second(time - mean);
  const double slope = 2.0 * (now - mean) - a;  // of the second polynomial
  for (const double time : times) {
    const double u = time - mean;
    double weight = u / s2;
    if (parabola && square > 0.0) weight += slope * second(u) / square;
    weights.push_back(weight);
  }
  return weights;
}

}  // namespace

std::vector<Point2> FitVelocities(std::span<const double> times,
                                  std::span<const Point2> positions) {
  std::vector<Point2> velocities(times.size());
  size_t begin = 0;  // of the run without a gap
  for (size_t i = 0; i < times.size(); ++i) {
    if (i > 0 && times[i] - times[i - 1] > kMaxFitGap) begin = i;
    size_t first = begin;
    while (times[i] - times[first] > kWindow + kJitter) ++first;
    size_t last = i;
    while (last + 1 < times.size() && times[last] - times[begin] < kFirst - kJitter &&
           times[last + 1] - times[last] <= kMaxFitGap) {
      ++last;
    }
    if (first == last) continue;
    const std::span<const double> window = times.subspan(first, last - first + 1);
    const bool parabola = window.back() - window.front() >= kLineBelow - kJitter;
    const std::vector<double> weights = SlopeWeights(window, times[i], parabola);
    for (size_t k = 0; k < weights.size(); ++k) {
      velocities[i].x += weights[k] * (positions[first + k].x - positions[i].x);
      velocities[i].y += weights[k] * (positions[first + k].y - positions[i].y);
    }
  }
  return velocities;
}

}  // namespace maneuver::data
