#include "model/scene/road_map.h"

#include <algorithm>
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

}  // namespace

struct RoadMap::LazyLanes {
  std::once_flag once;
  std::optional<LaneGraph> graph;
};

RoadMap::RoadMap(MapFeatures features)
    : RoadMap(std::make_unique<const MapFeatures>(std::move(features)), nullptr) {}

RoadMap RoadMap::Over(const MapFeatures& features) { return RoadMap(nullptr, &features); }

RoadMap::RoadMap(std::unique_ptr<const MapFeatures> owned, const MapFeatures* others)
    : owned_(std::move(owned)),
      features_(owned_ != nullptr ? owned_.get() : others),
      lanes_(std::make_unique<LazyLanes>()) {
  constexpr int kIntervals = kStretchPoints - 1;
  size_t stretches = 0;
  for (const v1::MapFeature& feature : *features_) {
    stretches += static_cast<size_t>(feature.x_size() / kIntervals + 1);
  }
  stretches_.reserve(stretches);
  boxes_.reserve(static_cast<size_t>(features_->size()));
  first_stretches_.reserve(static_cast<size_t>(features_->size()) + 1);
  std::vector<kernels::PointSpread> spreads;  // of a feature
  for (const v1::MapFeature& feature : *features_) {
    first_stretches_.push_back(stretches_.size());
    Box box{kInfinity, kInfinity, -kInfinity, -kInfinity};
    const int count = std::min(feature.x_size(), feature.y_size());
    spreads.resize(static_cast<size_t>(kernels::SpreadsOf(count, kIntervals)));
    kernels::FindSpreads(feature.x().data(), feature.y().data(), count, kIntervals, spreads.data());
    int left = count - 1;  // intervals
    for (const kernels::PointSpread& spread : spreads) {
      stretches_.push_back(StretchOf(spread, std::min(kIntervals, left)));
      box = box.With(stretches_.back().box);
      left -= kIntervals;
    }
    boxes_.push_back(box);
  }
  first_stretches_.push_back(stretches_.size());
  bytes_ =
      static_cast<int64_t>(sizeof(*this) + sizeof(LazyLanes) + boxes_.capacity() * sizeof(Box) +
                           stretches_.capacity() * sizeof(Stretch) +
                           first_stretches_.capacity() * sizeof(size_t)) +
      LaneGraph::MostBytes(*features_);
  if (owned_ != nullptr) bytes_ += static_cast<int64_t>(owned_->SpaceUsedExcludingSelfLong());
}

RoadMap::~RoadMap() = default;
RoadMap::RoadMap(RoadMap&&) noexcept = default;
RoadMap& RoadMap::operator=(RoadMap&&) noexcept = default;

const LaneGraph& RoadMap::lanes() const {
  std::call_once(lanes_->once, [this] { lanes_->graph.emplace(*features_); });
  return *lanes_->graph;
}

}  // namespace maneuver::scene
