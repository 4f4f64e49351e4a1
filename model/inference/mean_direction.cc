#include "model/inference/mean_direction.h"

#include <algorithm>
#include <cmath>

namespace maneuver::inference {

Trajectory MeanDirections(const Trajectory& mean, double waypoint_interval) {
  constexpr double kHalfWindow = 0.2;    // seconds
  constexpr double kSlowestSpeed = 0.5;  // m/s
  const Eigen::Index half = std::lround(kHalfWindow / waypoint_interval);
  Trajectory directions(mean.rows(), 2);
  for (Eigen::Index t = 0; t < mean.rows(); ++t) {
    // The steps of a window add up to the way from before the first of them to the last.
    const Eigen::Index first = std::max<Eigen::Index>(0, t - half);
    const Eigen::Index last = std::min(mean.rows() - 1, t + half);
    Eigen::RowVector2d step = mean.row(last);
    if (first > 0) step -= mean.row(first - 1);
    step /= static_cast<double>(last - first + 1);
    const double length = step.norm();
    if (length < kSlowestSpeed * waypoint_interval) {
      directions.row(t) << 1.0, 0.0;
    } else {
      directions.row(t) = step / length;
    }
  }
  return directions;
}

}  // namespace maneuver::inference
