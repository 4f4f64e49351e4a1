// Lanelets as the lines of our maps.

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

// A piece of lane between its bounds, both in the direction of travel.
struct Lanelet {
  enum class Kind { kDriving, kBicycle, kCrosswalk, kSidewalk };

  int64_t id = 0;
  Kind kind = Kind::kDriving;
  Polyline left;   // at least two points
  Polyline right;  // at least two points
  // The lanelet beside it that shares the bound, in either direction of travel.
  std::optional<int64_t> beside_left;
  std::optional<int64_t> beside_right;
  // The same if both are driven in one direction.
  std::optional<int64_t> neighbor_left;
  std::optional<int64_t> neighbor_right;
  std::vector<int64_t> successors;
  std::vector<int64_t> predecessors;
  std::vector<Polyline> stop_lines;
  double speed_limit = 0.0;  // metres per second; 0: not known
};

// Halfway between the bounds, with as many points as the one that has more; with equally many,
// between each two.
Polyline Centerline(const Lanelet& lanelet);

// Map features of all lanelets:
//   a centreline for each that is driven or cycled on, under the lanelet's id, with its successors
//   (as the lanelet or its successor states them) and neighbours, as many as ScenarioLimits
//   accepts; an area for each crosswalk; road lines where two lanelets lie side by side and share a
//   bound, once for both; road edges: the outline of all lanelets together, so none across a
//   junction, where lanelets overlap; stop lines.
// Lines and edges have no id.
std::vector<v1::MapFeature> MapOf(const std::vector<Lanelet>& lanelets);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_COMMONROAD_LANELET_MAP_H_
