#include "model/scene/road_map.h"

#include <algorithm>
#include <cassert>
#include <limits>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "model/kernels/points.h"
#include "model/scene/lane_graph.h"

namespace maneuver::scene {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

size_t MostStretches(const v1::MapFeature& feature) {
  return static_cast<size_t>(feature.x_size() / (Stretches::kStretchPoints - 1) + 1);
}

// `intervals`: of the stretch's points.
Stretch StretchOf(const kernels::PointSpread& spread, int intervals) {
  Stretch stretch{{spread.low_x, spread.low_y, spread.high_x, spread.high_y}, kInfinity};
  if (intervals < 2) {
    stretch.squared_bend = 0.0;
  } else if (spread.chord_squared > 0.0 && !spread.astray) {
    stretch.squared_bend = spread.across_squared / spread.chord_squared;
  }
  return stretch;
}

std::vector<Box> BoxesOf(const MapFeatures& features) {
  std::vector<Box> boxes;
  FindBoxes(features, &boxes);
  return boxes;
}

}  // namespace

bool FindBoxes(const MapFeatures& features, std::vector<Box>* boxes) {
  std::vector<kernels::PointLine> lines;
  lines.reserve(static_cast<size_t>(features.size()));
  for (const v1::MapFeature& feature : features) {
    lines.push_back(
        {feature.x().data(), feature.y().data(), static_cast<size_t>(PointsOf(feature))});
  }
  boxes->resize(lines.size());
  return kernels::FindBoxes(lines, boxes->data());
}

Stretches::Stretches(const MapFeatures& features) {
  constexpr int kIntervals = kStretchPoints - 1;
  size_t stretches = 0;
  for (const v1::MapFeature& feature : features) stretches += MostStretches(feature);
  stretches_.reserve(stretches);
  first_.reserve(static_cast<size_t>(features.size()) + 1);
  std::vector<kernels::PointSpread> spreads;  // of a feature
  for (const v1::MapFeature& feature : features) {
    first_.push_back(stretches_.size());
    const int count = PointsOf(feature);
    spreads.resize(static_cast<size_t>(kernels::SpreadsOf(count, kIntervals)));
    kernels::FindSpreads(feature.x().data(), feature.y().data(), count, kIntervals, spreads.data());
    int left = count - 1;  // intervals
    for (const kernels::PointSpread& spread : spreads) {
      stretches_.push_back(StretchOf(spread, std::min(kIntervals, left)));
      left -= kIntervals;
    }
  }
  first_.push_back(stretches_.size());
}

int64_t Stretches::MostBytes(const MapFeatures& features) {
  size_t stretches = 0;
  for (const v1::MapFeature& feature : features) stretches += MostStretches(feature);
  return static_cast<int64_t>(sizeof(Stretches) + stretches * sizeof(Stretch) +
                              (static_cast<size_t>(features.size()) + 1) * sizeof(size_t));
}

struct RoadMap::Lazy {
  std::once_flag stretches_once;
  std::optional<Stretches> stretches;
  std::once_flag lanes_once;
  std::optional<LaneGraph> lanes;
  std::once_flag bytes_once;
  int64_t bytes;
};

RoadMap::RoadMap(MapFeatures features)
    : RoadMap(std::make_unique<const MapFeatures>(std::move(features)), nullptr, {}) {
  boxes_ = BoxesOf(*features_);
}

RoadMap RoadMap::Over(const MapFeatures& features) {
  return RoadMap(nullptr, &features, BoxesOf(features));
}

RoadMap RoadMap::Over(const MapFeatures& features, std::vector<Box> boxes) {
  assert(boxes.size() == static_cast<size_t>(features.size()));
  return RoadMap(nullptr, &features, std::move(boxes));
}

RoadMap::RoadMap(std::unique_ptr<const MapFeatures> owned, const MapFeatures* others,
                 std::vector<Box> boxes)
    : owned_(std::move(owned)),
      features_(owned_ != nullptr ? owned_.get() : others),
      boxes_(std::move(boxes)),
      lazy_(std::make_unique<Lazy>()) {}

RoadMap::~RoadMap() = default;
RoadMap::RoadMap(RoadMap&&) noexcept = default;
RoadMap& RoadMap::operator=(RoadMap&&) noexcept = default;

const Stretches& RoadMap::stretches() const {
  std::call_once(lazy_->stretches_once, [this] { lazy_->stretches.emplace(*features_); });
  return *lazy_->stretches;
}

const LaneGraph& RoadMap::lanes() const {
  std::call_once(lazy_->lanes_once, [this] { lazy_->lanes.emplace(*features_, boxes_); });
  return *lazy_->lanes;
}

int64_t RoadMap::bytes() const {
  std::call_once(lazy_->bytes_once, [this] {
    lazy_->bytes =
        static_cast<int64_t>(sizeof(*this) + sizeof(Lazy) + boxes_.capacity() * sizeof(Box)) +
        Stretches::MostBytes(*features_) + LaneGraph::MostBytes(*features_);
    if (owned_ != nullptr) {
      lazy_->bytes += static_cast<int64_t>(owned_->SpaceUsedExcludingSelfLong());
    }
  });
  return lazy_->bytes;
}

}  // namespace maneuver::scene
