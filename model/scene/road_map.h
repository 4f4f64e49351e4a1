// A map that many scenarios share, with what the rasterizer would otherwise find out each time.

#ifndef MANEUVER_MODEL_SCENE_ROAD_MAP_H_
#define MANEUVER_MODEL_SCENE_ROAD_MAP_H_

#include <cstdint>
#include <vector>

#include "maneuver/v1/scenario.pb.h"

namespace maneuver::scene {

using MapFeatures = google::protobuf::RepeatedPtrField<v1::MapFeature>;

// An upright rectangle in the world, metres.
struct Box {
  double low_x;
  double low_y;
  double high_x;
  double high_y;

  bool Overlaps(const Box& other) const {
    return low_x <= other.high_x && other.low_x <= high_x && low_y <= other.high_y &&
           other.low_y <= high_y;
  }
};

// Does not change; safe to share between threads.
class RoadMap {
 public:
  // `features` are such as ValidateMap found good.
  explicit RoadMap(MapFeatures features);

  const MapFeatures& features() const { return features_; }
  // Around the points of each feature.
  const std::vector<Box>& boxes() const { return boxes_; }
  // Memory that it takes.
  int64_t bytes() const { return bytes_; }

 private:
  MapFeatures features_;
  std::vector<Box> boxes_;  // [features]
  int64_t bytes_;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_ROAD_MAP_H_
