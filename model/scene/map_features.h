// The features of a map, and the boxes that lie around parts of it.

#ifndef MANEUVER_MODEL_SCENE_MAP_FEATURES_H_
#define MANEUVER_MODEL_SCENE_MAP_FEATURES_H_

#include <algorithm>

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
  // Returns the box around both.
  Box With(const Box& other) const {
    return {std::min(low_x, other.low_x), std::min(low_y, other.low_y),
            std::max(high_x, other.high_x), std::max(high_y, other.high_y)};
  }
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_MAP_FEATURES_H_
