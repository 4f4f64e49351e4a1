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

// Finds the box around the points of each feature. Returns whether all coordinates are finite; if
// not, the boxes have no meaning.
bool FindBoxes(const MapFeatures& features, std::vector<Box>* boxes);

// A stretch of a feature: consecutive points, beginning with the last point of the stretch before.
struct Stretch {
  Box box;
  // Square of the largest distance of its points from the straight line between its ends, square
  // metres. Infinite if the points do not advance from one end to the other.
  double squared_bend;
};

// The stretches of the features of a map. Each has kStretchPoints - 1 intervals, the last one of a
// feature possibly fewer. Stretch j begins at the feature's point j * (kStretchPoints - 1).
class Stretches {
 public:
  static constexpr int kStretchPoints = 17;

  explicit Stretches(const MapFeatures& features);
  // Returns an upper bound of the memory in use.
  static int64_t MostBytes(const MapFeatures& features);

  // Returns those of feature i.
  std::span<const Stretch> operator[](int i) const {
    const auto feature = static_cast<size_t>(i);
    return {stretches_.data() + first_[feature], first_[feature + 1] - first_[feature]};
  }

 private:
  std::vector<Stretch> stretches_;  // of all features, one after the other
  std::vector<size_t> first_;       // [features + 1], into stretches_
};

class LaneGraph;

// Immutable after construction; safe to share between threads.
class RoadMap {
 public:
  // ValidateMap must accept `features`.
  explicit RoadMap(MapFeatures features);
  // Indexes features that the caller owns, such as a scenario's own map. They must stay unchanged
  // for as long as the RoadMap lives.
  //   boxes: as ValidateScenario finds them
  static RoadMap Over(const MapFeatures& features);
  static RoadMap Over(const MapFeatures& features, std::vector<Box> boxes);
  ~RoadMap();
  RoadMap(RoadMap&&) noexcept;
  RoadMap& operator=(RoadMap&&) noexcept;

  const MapFeatures& features() const { return *features_; }
  // Returns the box around the points of each feature.
  const std::vector<Box>& boxes() const { return boxes_; }
  // Return the stretches of the features, for drawing, and their driving lanes. The first call
  // builds them. Safe from any thread.
  const Stretches& stretches() const;
  const LaneGraph& lanes() const;
  // Returns the memory in use, including features that it owns. Counts stretches() and lanes() from
  // the start, so the number does not change when they are built. The first call counts.
  int64_t bytes() const;

 private:
  struct Lazy;

  // One of the first two is nullptr.
  RoadMap(std::unique_ptr<const MapFeatures> owned, const MapFeatures* others,
          std::vector<Box> boxes);

  std::unique_ptr<const MapFeatures> owned_;  // or nullptr
  const MapFeatures* features_;
  std::vector<Box> boxes_;  // [features]
  std::unique_ptr<Lazy> lazy_;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_ROAD_MAP_H_
