// A map that several targets or scenarios share, with an index that would otherwise be rebuilt for
// each of them.

#ifndef MANEUVER_MODEL_SCENE_ROAD_MAP_H_
#define MANEUVER_MODEL_SCENE_ROAD_MAP_H_

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "model/scene/map_features.h"

namespace maneuver::scene {

// A stretch of a feature: consecutive points, beginning with the last point of the stretch before.
struct Stretch {
  Box box;
  // Square of the largest distance of its points from the straight line between its ends, square
  // metres. Infinite if the points do not advance from one end to the other.
  double squared_bend;
};

class LaneGraph;

// Immutable after construction; safe to share between threads.
class RoadMap {
 public:
  // ValidateMap must accept `features`.
  explicit RoadMap(MapFeatures features);
  // Indexes features that the caller owns, such as a scenario's own map. They must stay unchanged
  // for as long as the RoadMap lives.
  static RoadMap Over(const MapFeatures& features);
  ~RoadMap();
  RoadMap(RoadMap&&) noexcept;
  RoadMap& operator=(RoadMap&&) noexcept;

  const MapFeatures& features() const { return *features_; }
  // Returns the box around the points of each feature.
  const std::vector<Box>& boxes() const { return boxes_; }
  // Returns the stretches of feature i. Each has kStretchPoints - 1 intervals, the last one
  // possibly fewer. Stretch j begins at the feature's point j * (kStretchPoints - 1).
  std::span<const Stretch> stretches(int i) const {
    const auto feature = static_cast<size_t>(i);
    return {stretches_.data() + first_stretches_[feature],
            first_stretches_[feature + 1] - first_stretches_[feature]};
  }
  static constexpr int kStretchPoints = 17;
  // Returns the driving lanes of the features. The first call builds them. Safe from any thread.
  const LaneGraph& lanes() const;
  // Returns the memory in use, including features that it owns. Counts lanes() from the start, so
  // the number does not change when they are built.
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
