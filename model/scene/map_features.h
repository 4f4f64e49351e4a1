// The features of a map, and the boxes that lie around parts of it.

#ifndef MANEUVER_MODEL_SCENE_MAP_FEATURES_H_
#define MANEUVER_MODEL_SCENE_MAP_FEATURES_H_

#include <algorithm>

#include "maneuver/v1/scenario.pb.h"
#include "model/kernels/points.h"

namespace maneuver::scene {

using MapFeatures = google::protobuf::RepeatedPtrField<v1::MapFeature>;

// An upright rectangle in the world, metres.
using Box = kernels::PointBox;

// Returns the number of points that have both coordinates.
inline int PointsOf(const v1::MapFeature& feature) {
  return std::min(feature.x_size(), feature.y_size());
}

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_MAP_FEATURES_H_
