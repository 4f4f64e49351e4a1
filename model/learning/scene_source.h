// The recordings of an example set with their indexed road maps.

#ifndef MANEUVER_MODEL_LEARNING_SCENE_SOURCE_H_
#define MANEUVER_MODEL_LEARNING_SCENE_SOURCE_H_

#include <optional>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "model/learning/training_data.h"
#include "model/scene/road_map.h"

namespace maneuver::learning {

// Owns the indexed maps of a set for a whole run: every pass over the examples shares them.
// Immutable; safe to share between threads.
class SceneSource {
 public:
  // Indexes the map of every recording on `threads` threads, and also its lanes if `spec` reads
  // lane paths. `set` must outlive the source and must not change.
  SceneSource(const v1::ModelSpec& spec, const ExampleSet& set, int threads);

  const ExampleSet& set() const { return set_; }
  // Returns the map of recording `recording` of the set.
  const scene::RoadMap& map(int recording) const { return *maps_[static_cast<size_t>(recording)]; }

 private:
  const ExampleSet& set_;
  std::vector<std::optional<scene::RoadMap>> maps_;  // [recordings], each of them set
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_SCENE_SOURCE_H_
