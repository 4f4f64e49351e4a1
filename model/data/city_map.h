// The map of a whole city, from which each recording gets its surroundings.

#ifndef MANEUVER_MODEL_DATA_CITY_MAP_H_
#define MANEUVER_MODEL_DATA_CITY_MAP_H_

#include <span>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "model/scene/map_features.h"
#include "model/scene/pose2.h"

namespace maneuver::data {

// Holds the features once for all recordings. May be read from several threads.
class CityMap {
 public:
  // Distance from the path up to which features are kept, metres. A vehicle at 15 m/s covers 120 m
  // in 8 s.
  static constexpr double kReach = 150.0;

  CityMap() = default;
  explicit CityMap(std::vector<v1::MapFeature> features);

  // Appends to `scenario` each feature whose bounding box comes within kReach of the path, whole
  // and in the order of the map.
  //   path: world frame, metres, in order. Points less than 5 m from the one before may be ignored.
  void AddNear(std::span<const scene::Point2> path, v1::Scenario* scenario) const;

  const std::vector<v1::MapFeature>& features() const { return features_; }

 private:
  std::vector<v1::MapFeature> features_;
  std::vector<scene::Box> boxes_;  // of each feature
};

// Returns the heading of the lane centreline nearest to `point`, radians; `otherwise` if none is
// within `reach` metres.
double LaneHeadingAt(const v1::Scenario& scenario, const scene::Point2& point, double reach,
                     double otherwise);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_CITY_MAP_H_
