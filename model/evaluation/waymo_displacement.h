// Displacement errors as the Waymo Open Motion benchmark defines them.
//
// The benchmark looks at 2 Hz, and reports minADE, minFDE and misses up to, or at, 3, 5 and 8 s,
// and their means over those. Here those of the three that the horizon reaches count.

#ifndef MANEUVER_MODEL_EVALUATION_WAYMO_DISPLACEMENT_H_
#define MANEUVER_MODEL_EVALUATION_WAYMO_DISPLACEMENT_H_

#include <span>
#include <vector>

#include "model/inference/action_model.h"

namespace maneuver::evaluation {

using inference::Trajectory;

// How far off a prediction may be, metres, along and across the truth's heading.
struct WaymoThresholds {
  double lateral = 0.0;
  double longitudinal = 0.0;
};

// Factor for the thresholds: 0.5 below 1.4 m/s, 1 above 11 m/s, linear between.
double WaymoSpeedScale(double initial_speed);

// At `time` 3, 5 or 8 s: 1.0 / 2.0, 1.8 / 3.6, 3.0 / 6.0 m, times the speed's scale.
WaymoThresholds ThresholdsAt(double time, double initial_speed);

struct WaymoErrors {
  double min_ade = 0.0;    // metres; mean over the measured times of the minADE up to each
  double min_fde = 0.0;    // metres; mean over the measured times of the least distance at each
  double miss_rate = 0.0;  // share of the measured times that none of the first k hits
};

// Measures predictions against one truth.
class WaymoMeasure {
 public:
  //   waypoint_times: [T] seconds, increasing
  explicit WaymoMeasure(std::vector<double> waypoint_times);

  // Those of 3, 5 and 8 s that the horizon reaches; empty if it ends before.
  const std::vector<double>& measured_times() const { return measured_times_; }

  // Errors of the best of the first k of `ranked`; k may exceed their number. Needs a measured
  // time. Between waypoints predictions and truth are interpolated linearly, and before the first
  // from the origin.
  //   truth_headings: of the target at each measured time, target frame, radians
  //   initial_speed: of the target at the prediction time, m/s
  WaymoErrors BestOf(std::span<const Trajectory> ranked, int k, const Trajectory& truth,
                     std::span<const double> truth_headings, double initial_speed) const;

 private:
  // Where `time` lies: between waypoints `before` (-1: the origin) and before + 1.
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
