// Converts a scene to the JSON that the page draws.

#ifndef MANEUVER_CLIENT_REPORT_SCENE_JSON_H_
#define MANEUVER_CLIENT_REPORT_SCENE_JSON_H_

#include <nlohmann/json.hpp>
#include <vector>

#include "client/report/report_data.h"

namespace maneuver::report {

// Returns the number rounded to `digits` decimals, to keep a page short. Numbers that are not
// finite are printed as null.
double Rounded(double value, int digits);

// Returns x and y of each of `waypoints`, metres: [x0, y0, x1, y1, ...].
nlohmann::json PointsJson(const v1::Trajectory& trajectory, const std::vector<int>& waypoints);
// Returns the distribution of an action: {"id", "p", "mean": [x, y, ...], "cov": [xx, xy, yy,
// ...]}.
nlohmann::json DistributionJson(const v1::ActionDistribution& distribution,
                                const std::vector<int>& waypoints);

// Returns what the page shows of a scene: the scores and groups of the example, its probabilities
// and responsibilities, the truth and the distributions; and everything near the target, in the
// target's frame: map features cut to the view and thinned where lines are straight, the states of
// the target and of at most the 79 nearest agents from one second before the prediction time to the
// last waypoint, and signals.
//   waypoints: indices of the waypoints to draw
//   horizon: time of the last waypoint, seconds
nlohmann::json SceneJson(const Scene& scene, const std::vector<int>& waypoints, double horizon);

}  // namespace maneuver::report

#endif  // MANEUVER_CLIENT_REPORT_SCENE_JSON_H_
