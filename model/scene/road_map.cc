#include "model/scene/road_map.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace maneuver::scene {
namespace {

Box BoxAround(const v1::MapFeature& feature) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  Box box{kInfinity, kInfinity, -kInfinity, -kInfinity};
  for (const double x : feature.x()) {
    box.low_x = std::min(box.low_x, x);
    box.high_x = std::max(box.high_x, x);
  }
  for (const double y : feature.y()) {
    box.low_y = std::min(box.low_y, y);
    box.high_y = std::max(box.high_y, y);
  }
  return box;
}

}  // namespace

RoadMap::RoadMap(MapFeatures features) : features_(std::move(features)) {
  boxes_.reserve(static_cast<size_t>(features_.size()));
  for (const v1::MapFeature& feature : features_) boxes_.push_back(BoxAround(feature));
  bytes_ = static_cast<int64_t>(sizeof(*this) + boxes_.capacity() * sizeof(Box) +
                                features_.SpaceUsedExcludingSelfLong());
}

}  // namespace maneuver::scene
