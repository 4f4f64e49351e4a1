#include "model/learning/scene_source.h"

#include "model/artifact/model_spec.h"
#include "model/machine/parallel.h"

namespace maneuver::learning {

SceneSource::SceneSource(const v1::ModelSpec& spec, const ExampleSet& set, int threads)
    : set_(set), maps_(set.recordings.size()) {
  const bool reads_lanes = artifact::ReadsLanePaths(spec);
  machine::ForEachOnThreads(maps_.size(), threads, [&](size_t i) {
    maps_[i].emplace(scene::RoadMap::Over(set_.recordings[i].map_features()));
    if (reads_lanes) maps_[i]->lanes();
  });
}

}  // namespace maneuver::learning
