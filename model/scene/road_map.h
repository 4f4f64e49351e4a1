// A map that several targets or scenarios share, with what the rasterizer would otherwise find out
// each time.

#ifndef MANEUVER_MODEL_SCENE_ROAD_MAP_H_
#define MANEUVER_MODEL_SCENE_ROAD_MAP_H_

#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>
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
  // Around both.
  Box With(const Box& other) const {
    return {std::min(low_x, other.low_x), std::min(low_y, other.low_y),
            std::max(high_x, other.high_x), std::max(high_y, other.high_y)};
  }
};

// A piece of a feature: its points from the last one of the piece before, in order.
struct Stretch {
  Box box;
  // How far its points lie from the straight line between its ends, metres, squared; infinite if
  // they do not go from one to the other.
  double squared_bend;
};

class LaneGraph;

// Does not change; safe to share between threads.
class RoadMap {
 public:
  // `features` are such as ValidateMap found good.
  explicit RoadMap(MapFeatures features);
  // Of features that are somebody else's and stay where they are for as long as it lives: a
  // scenario's own, which all its targets share.
  static RoadMap Over(const MapFeatures& features);
  ~RoadMap();
  RoadMap(RoadMap&&) noexcept;
  RoadMap& operator=(RoadMap&&) noexcept;

  const MapFeatures& features() const { return *features_; }
  // Around the points of each feature.
  const std::vector<Box>& boxes() const { return boxes_; }
  // Feature i's pieces, of kStretchPoints - 1 intervals each but for the last: piece j begins with
  // its point j * (kStretchPoints - 1).
  std::span<const Stretch> stretches(int i) const {
    const auto feature = static_cast<size_t>(i);
    return {stretches_.data() + first_stretches_[feature],
            first_stretches_[feature + 1] - first_stretches_[feature]};
  }
  static constexpr int kStretchPoints = 17;
  // Returns the driving lanes of the features. The first call builds them; any thread may make it.
  const LaneGraph& lanes() const;
  // Memory that it takes, its own features included. Counts lanes() from the start, so that the
  // number does not change when they are built.
  int64_t bytes() const { return bytes_; }

 private:
  struct LazyLanes;

  // One of the two is nullptr.
  RoadMap(std::unique_ptr<const MapFeatures> owned, const MapFeatures* others);

  std::unique_ptr<const MapFeatures> owned_;  // or nullptr
  const MapFeatures* features_;
  std::vector<Box> boxes_;               // [features]
  std::vector<Stretch> stretches_;       // of all features, one after the other
  std::vector<size_t> first_stretches_;  // [features + 1], into stretches_
  std::unique_ptr<LazyLanes> lanes_;
  int64_t bytes_;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_ROAD_MAP_H_
