// Private to plot/: trajectories that begin at the origin, and the numbers at their ends.

#ifndef MANEUVER_CLIENT_PLOT_TRAJECTORY_POINTS_H_
#define MANEUVER_CLIENT_PLOT_TRAJECTORY_POINTS_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/plot/axes.h"
#include "client/plot/canvas.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "model/scene/pose2.h"

namespace maneuver::plot {

using Points = std::vector<scene::Point2>;  // metres, from the origin on

// Returns the origin and the waypoints. INVALID_ARGUMENT if there are unequal numbers of x and y.
//   what: begins the error: "a trajectory of action 3"
absl::StatusOr<Points> PointsOf(const v1::Trajectory& trajectory, const std::string& what);

Line ToPixels(const Axes& axes, const Points& points);

// The end of an action's mean.
struct ActionEnd {
  int id;
  Pixel pixel;
};

struct ActionIdStyle {
  double dot;        // side of the square at each end that stays free, pixels
  double letters;    // pixels
  double farthest;   // at most so far from the end, pixels
  double least_gap;  // a label that is further away than this is joined to its end, pixels
  double opacity;    // of that line
};

// Draws the id of each action near the end of its mean, where there is room.
void DrawActionIds(const Box& whole, const std::vector<ActionEnd>& ends, const ActionIdStyle& style,
                   Canvas* canvas);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_TRAJECTORY_POINTS_H_
