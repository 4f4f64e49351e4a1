#include "model/data/city_map.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace maneuver::data {
namespace {

using scene::Point2;

// Points of a path closer than this to the last one kept add nothing, metres.
constexpr double kStep = 5.0;

std::vector<Point2> Thinned(std::span<const Point2> path) {
  std::vector<Point2> kept;
  for (const Point2& point : path) {
    if (kept.empty() || std::hypot(point.x - kept.back().x, point.y - kept.back().y) >= kStep) {
      kept.push_back(point);
    }
  }
  return kept;
}

// Returns how far a number lies outside an interval.
double Outside(double value, double low, double high) {
  return std::max({low - value, value - high, 0.0});
}

}  // namespace

CityMap::CityMap(std::vector<v1::MapFeature> features) : features_(std::move(features)) {
  for (const v1::MapFeature& feature : features_) {
    scene::Box& box = boxes_.emplace_back();
    if (feature.x().empty()) continue;
    const auto [low_x, high_x] = std::minmax_element(feature.x().begin(), feature.x().end());
    const auto [low_y, high_y] = std::minmax_element(feature.y().begin(), feature.y().end());
    box = {*low_x, *low_y, *high_x, *high_y};
  }
}

void CityMap::AddNear(std::span<const Point2> path, v1::Scenario* scenario) const {
  const std::vector<Point2> points = Thinned(path);
  for (size_t i = 0; i < features_.size(); ++i) {
    const scene::Box& box = boxes_[i];
    const bool near = std::any_of(points.begin(), points.end(), [&box](const Point2& point) {
      return std::hypot(Outside(point.x, box.low_x, box.high_x),
                        Outside(point.y, box.low_y, box.high_y)) <= kReach;
    });
    if (near) *scenario->add_map_features() = features_[i];
  }
}

double LaneHeadingAt(const v1::Scenario& scenario, const Point2& point, double reach,
                     double otherwise) {
  double nearest = reach;
  double heading = otherwise;
  for (const v1::MapFeature& feature : scenario.map_features()) {
    if (feature.type() != v1::MAP_FEATURE_TYPE_LANE_CENTERLINE) continue;
    for (int i = 1; i < feature.x_size(); ++i) {
      const double along_x = feature.x(i) - feature.x(i - 1);
      const double along_y = feature.y(i) - feature.y(i - 1);
      const double square = along_x * along_x + along_y * along_y;
      if (!(square > 0.0)) continue;
      const double share = std::clamp(
          ((point.x - feature.x(i - 1)) * along_x + (point.y - feature.y(i - 1)) * along_y) /
              square,
          0.0, 1.0);
      const double distance = std::hypot(feature.x(i - 1) + share * along_x - point.x,
                                         feature.y(i - 1) + share * along_y - point.y);
      if (distance > nearest) continue;
      nearest = distance;
      heading = std::atan2(along_y, along_x);
    }
  }
  return heading;
}

}  // namespace maneuver::data
