#include "model/scene/road_map.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <mutex>
#include <optional>
#include <utility>

#include "model/scene/lane_graph.h"
#include "model/scene/lanes.h"

namespace maneuver::scene {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Points first .. last of a feature.
class Points {
 public:
  Points(const v1::MapFeature& feature, int first, int last)
      : x_(feature.x().data()), y_(feature.y().data()), first_(first), last_(last) {}

  Stretch Describe() const {
    const double start_x = x_[first_];
    const double start_y = y_[first_];
    const double dx = x_[last_] - start_x;
    const double dy = y_[last_] - start_y;
    const double squared = dx * dx + dy * dy;
    DoubleLanes low_x = x_[last_] + DoubleLanes{};
    DoubleLanes low_y = y_[last_] + DoubleLanes{};
    DoubleLanes high_x = low_x;
    DoubleLanes high_y = low_y;
    DoubleLanes farthest = {};
    MaskLanes astray = {};
    for (int i = first_; i < last_; i += kPointLanes) {
      const DoubleLanes x = Four(x_, i);
      const DoubleLanes y = Four(y_, i);
      low_x = Least(low_x, x);
      low_y = Least(low_y, y);
      high_x = Most(high_x, x);
      high_y = Most(high_y, y);
      const DoubleLanes off_x = x - start_x;
      const DoubleLanes off_y = y - start_y;
      const DoubleLanes across = off_x * dy - off_y * dx;
      const DoubleLanes along = off_x * dx + off_y * dy;
      farthest = Most(farthest, across * across);
      astray |= (along < 0.0) | (along > squared);
    }
    double most = 0.0;
    Stretch stretch{{low_x[0], low_y[0], high_x[0], high_y[0]}, kInfinity};
    for (int lane = 0; lane < kPointLanes; ++lane) {
      stretch.box = stretch.box.With({low_x[lane], low_y[lane], high_x[lane], high_y[lane]});
      most = std::max(most, farthest[lane]);
    }
    if (last_ - first_ < 2) {
      stretch.squared_bend = 0.0;
    } else if (squared > 0.0 && !AnyOf(astray)) {
      stretch.squared_bend = most / squared;
    }
    return stretch;
  }

 private:
  DoubleLanes Four(const double* values, int i) const {
    if (i + kPointLanes <= last_) {
      DoubleLanes four;
      std::memcpy(&four, values + i, sizeof(four));
      return four;
    }
    const auto at = [&](int j) { return values[std::min(j, last_)]; };
    return DoubleLanes{at(i), at(i + 1), at(i + 2), at(i + 3)};
  }

  const double* const x_;
  const double* const y_;
  const int first_;
  const int last_;
};

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
  for (const v1::MapFeature& feature : *features_) {
    first_stretches_.push_back(stretches_.size());
    Box box{kInfinity, kInfinity, -kInfinity, -kInfinity};
    const int last = std::min(feature.x_size(), feature.y_size()) - 1;
    for (int first = 0; first <= last; first += kIntervals) {
      if (first == last && first > 0) break;  // the last point of the stretch before
      stretches_.push_back(Points(feature, first, std::min(first + kIntervals, last)).Describe());
      box = box.With(stretches_.back().box);
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
