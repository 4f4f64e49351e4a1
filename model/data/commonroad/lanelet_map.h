// Turns lanelets into the lines of a map.

#ifndef MANEUVER_MODEL_DATA_COMMONROAD_LANELET_MAP_H_
#define MANEUVER_MODEL_DATA_COMMONROAD_LANELET_MAP_H_

#include <cstdint>
#include <optional>
#include <vector>

#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

struct MapPoint {
  double x = 0.0;  // metres
  double y = 0.0;
};
using Polyline = std::vector<MapPoint>;

// A stretch of lane between two bounds, which run in the direction of travel.
struct Lanelet {
  enum class Kind { kDriving, kBicycle, kCrosswalk, kSidewalk };

  int64_t id = 0;
  Kind kind = Kind::kDriving;
  Polyline left;   // at least two points
  Polyline right;  // at least two points
  // The neighbouring lanelet that shares the bound, in either direction of travel.
  std::optional<int64_t> beside_left;
  std::optional<int64_t> beside_right;
  // The same, but only if both are driven in one direction.
  std::optional<int64_t> neighbor_left;
  std::optional<int64_t> neighbor_right;
  std::vector<int64_t> successors;
  std::vector<int64_t> predecessors;
  std::vector<Polyline> stop_lines;
  double speed_limit = 0.0;  // metres per second; 0: not known
};

// Returns the line halfway between the bounds. Has as many points as the bound with more points; if
// both have equally many, each point is the middle of a pair.
Polyline Centerline(const Lanelet& lanelet);

// Returns the map features of all lanelets:
//   - a centreline for each lanelet for cars or bicycles, under the lanelet's id, with its
//     successors (declared by either lanelet) and neighbours, as many as ScenarioLimits accepts;
//   - an area for each crosswalk;
//   - one road line for each bound that two neighbouring lanelets share;
//   - road edges: the outline of the union of all lanelets. There is none across a junction, where
//     lanelets overlap;
//   - stop lines.
// Lines and edges have no id.
std::vector<v1::MapFeature> MapOf(const std::vector<Lanelet>& lanelets);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_COMMONROAD_LANELET_MAP_H_
