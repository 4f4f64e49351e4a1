// Displacement errors as the Waymo Open Motion benchmark defines them.
//
// The benchmark samples at 2 Hz. It reports minADE up to 3, 5 and 8 s, minFDE and misses at these
// times, and the means over the three. Here, only those of the three that the horizon reaches
// count.

#ifndef MANEUVER_MODEL_EVALUATION_WAYMO_DISPLACEMENT_H_
#define MANEUVER_MODEL_EVALUATION_WAYMO_DISPLACEMENT_H_

#include <span>
#include <vector>

#include "model/inference/action_model.h"

namespace maneuver::evaluation {

using inference::Trajectory;

// How far off a prediction may be along and across the truth's heading, metres.
struct WaymoThresholds {
  double lateral = 0.0;
  double longitudinal = 0.0;
};

// Returns the factor of the thresholds: 0.5 below 1.4 m/s, 1 above 11 m/s, linear between.
double WaymoSpeedScale(double initial_speed);

// Returns lateral / longitudinal thresholds at `time` 3, 5 or 8 s: 1.0 / 2.0, 1.8 / 3.6, 3.0 / 6.0
// m, times the speed's factor.
WaymoThresholds ThresholdsAt(double time, double initial_speed);

struct WaymoErrors {
  double min_ade = 0.0;    // metres; mean over the measured times of the minADE up to each
  double min_fde = 0.0;    // metres; mean over the measured times of the least distance at each
  double miss_rate = 0.0;  // share of measured times at which all of the first k miss
};

// Measures predictions against one truth.
class WaymoMeasure {
 public:
  //   waypoint_times: [T] seconds, increasing
  explicit WaymoMeasure(std::vector<double> waypoint_times);

  // Returns those of 3, 5 and 8 s that the horizon reaches; may be empty.
  const std::vector<double>& measured_times() const { return measured_times_; }

  // Returns the errors of the best of the first k of `ranked`. k may exceed their number. Needs at
  // least one measured time. Predictions and truth are interpolated linearly between waypoints, and
  // from the origin before the first.
  //   truth_headings: heading of the target at each measured time, target frame, radians.
  //   initial_speed: speed of the target at the prediction time, m/s.
  WaymoErrors BestOf(std::span<const Trajectory> ranked, int k, const Trajectory& truth,
                     std::span<const double> truth_headings, double initial_speed) const;

 private:
  // A time between waypoints `before` (-1: the origin) and before + 1.
  struct Place {
    int before;
    double share;
  };
  Place Locate(double time) const;
  static Eigen::RowVector2d At(const Trajectory& trajectory, const Place& place);

  std::vector<double> waypoint_times_;
  std::vector<double> measured_times_;
  std::vector<Place> steps_;      // at 2 Hz, to the last measured time
  std::vector<size_t> measured_;  // index into steps_ of each measured time
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_WAYMO_DISPLACEMENT_H_
