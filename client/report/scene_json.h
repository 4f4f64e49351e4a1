// A scene as the page draws it.

#ifndef MANEUVER_CLIENT_REPORT_SCENE_JSON_H_
#define MANEUVER_CLIENT_REPORT_SCENE_JSON_H_

#include <nlohmann/json.hpp>
#include <vector>

#include "client/report/report_data.h"

namespace maneuver::report {

// The number rounded to `digits` decimals, so that a page is short. Numbers that are not finite
// become null when they are printed.
double Rounded(double value, int digits);

// x and y of each of `waypoints` in turn, metres: [x0, y0, x1, y1, ...].
nlohmann::json PointsJson(const v1::Trajectory& trajectory, const std::vector<int>& waypoints);
// The distribution of an action: {"id", "p", "mean": [x, y, ...], "cov": [xx, xy, yy, ...]}.
nlohmann::json DistributionJson(const v1::ActionDistribution& distribution,
                                const std::vector<int>& waypoints);

// Everything near the target, in the target's frame: map features cut to what is in sight and
// without the points that a straight line does not need, the states of agents from a second before
// the prediction time to the last waypoint, signals.
//   waypoints: indices of the waypoints to draw
//   horizon: time of the last waypoint, seconds
nlohmann::json SceneJson(const Scene& scene, const std::vector<int>& waypoints, double horizon);

}  // namespace maneuver::report

#endif  // MANEUVER_CLIENT_REPORT_SCENE_JSON_H_
